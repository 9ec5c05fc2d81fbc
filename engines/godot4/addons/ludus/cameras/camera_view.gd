extends RefCounted
## The viewport of one [LudusCamera3D] or [LudusCamera2D], and how old its picture is.

## The camera.
var camera: Node
## Its world; null where it has none.
var world: LudusWorld

var _viewport: RID
var _size := Vector2i.ZERO
## The tick of the picture; -1: there is none that counts.
var _drawn_tick: int = -1
## Number of episodes that the world had begun by then.
var _drawn_beginnings: int = 0
## The same when it was asked last whether there are new ones.
var _taken_beginnings: int = 0


func _init(own_camera: Node) -> void:
	camera = own_camera
	world = LudusWorld.find_above(camera)


## Frees the viewport.
func close() -> void:
	if _size != Vector2i.ZERO:
		RenderingServer.free_rid(_viewport)
	_size = Vector2i.ZERO


## The topmost node of what the camera sees.
func root() -> Node:
	if world != null:
		return world.root
	return camera.owner if camera.owner != null else camera


## Path of the camera, for messages.
func path_in_world() -> String:
	return str(camera.get_path() if world == null else world.root.get_path_to(camera))


## Whether the picture no longer counts: it lasts until a tick has passed, or an episode has begun.
func is_stale() -> bool:
	return _drawn_tick != Engine.get_physics_frames() or _drawn_beginnings != _num_beginnings()


## Lets the picture count no longer.
func forget() -> void:
	_drawn_tick = -1


## Returns whether an episode has begun since that was asked last.
func take_beginning() -> bool:
	var is_new := _taken_beginnings != _num_beginnings()
	_taken_beginnings = _num_beginnings()
	return is_new


## Has the picture drawn with the next frame of the renderer.
func prepare(scenario: RID) -> void:
	var size := _wanted_size()
	if _size != size:
		close()
		_open(size, scenario)
	camera.call(&"aim_viewport", _viewport)
	RenderingServer.viewport_set_update_mode(_viewport, RenderingServer.VIEWPORT_UPDATE_ONCE)
	_drawn_tick = Engine.get_physics_frames()
	_drawn_beginnings = _num_beginnings()


## Returns the picture.
func image() -> Image:
	var texture := RenderingServer.viewport_get_texture(_viewport)
	var picture := RenderingServer.texture_2d_get(texture)
	picture.convert(_format())
	return picture


## Returns a picture in which nothing is seen.
func black_image() -> Image:
	var size := _wanted_size()
	return Image.create_empty(size.x, size.y, false, _format())


func _open(size: Vector2i, scenario: RID) -> void:
	_size = size
	_viewport = RenderingServer.viewport_create()
	RenderingServer.viewport_set_size(_viewport, size.x, size.y)
	RenderingServer.viewport_set_active(_viewport, true)
	camera.call(&"connect_viewport", _viewport, scenario)


func _wanted_size() -> Vector2i:
	return Vector2i(camera.get(&"width") as int, camera.get(&"height") as int)


func _format() -> Image.Format:
	var is_grey := camera.get(&"channels") as int == LudusCamera3D.Channels.GREY
	return Image.FORMAT_L8 if is_grey else Image.FORMAT_RGB8


func _num_beginnings() -> int:
	if world == null:
		world = LudusWorld.find_above(camera)
	return world.num_beginnings if world != null else 0
