extends SceneTree
## Sends what the window shows to Python, frame by frame: recorder.gd for Godot 3.

const VARIABLE := "LUDUS_RECORD"
const BEGIN := 98
const END := 101

var _link := StreamPeerTCP.new()
var _every: int = 1
var _count: int = 0
var _is_filming: bool = false
## Whether the next drawing is a frame of the film; a game may draw more often than once a frame.
var _is_due: bool = false


func _initialize() -> void:
	var words := OS.get_environment(VARIABLE).split(" ")
	if words.size() != 3 or not _connect(int(words[0]), words[1]):
		printerr("ludus: nobody films this game")
		quit(1)
		return
	_every = int(words[2])
	if VisualServer.connect("frame_post_draw", self, "_on_frame_drawn") != OK:
		push_error("ludus: no signal frame_post_draw")


func _idle(_delta: float) -> bool:
	if _link.get_status() != StreamPeerTCP.STATUS_CONNECTED:
		quit()
		return false
	while _link.get_available_bytes() > 0:
		_obey(_link.get_u8())
	_count += 1
	_is_due = _is_filming and _count % _every == 0
	return false


func _connect(port: int, token: String) -> bool:
	if _link.connect_to_host("127.0.0.1", port) != OK:
		return false
	while _link.get_status() == StreamPeerTCP.STATUS_CONNECTING:
		OS.delay_msec(1)
	return _link.put_data(token.to_utf8()) == OK


func _obey(word: int) -> void:
	_is_filming = word == BEGIN
	_count = 0
	if word == END:
		_put_size(Vector2.ZERO)


func _on_frame_drawn() -> void:
	if not _is_due:
		return
	_is_due = false
	var picture := root.get_texture().get_data()
	picture.flip_y()
	picture.convert(Image.FORMAT_RGB8)
	_put_size(picture.get_size())
	_is_filming = _link.put_data(picture.get_data()) == OK


func _put_size(size: Vector2) -> void:
	_link.put_u32(int(size.x))
	_link.put_u32(int(size.y))
