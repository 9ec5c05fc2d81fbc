extends Reference
## One golden frame of [code]protocol/golden[/code] (see its README).

## File name without suffix.
var name: String
## Frame type (PROTOCOL.md §1).
var type: int
## What the frame carries.
var content: Dictionary
## The spec that a [code]STEP[/code] or a [code]BATCH[/code] belongs to.
var spec: Dictionary
## The token that a [code]CHALLENGE[/code], a [code]PROOF[/code] or a refusal proves.
var token: String
## The whole frame.
var frame: PoolByteArray


## Reads a golden frame.
func _init(folder: String, frame_name: String) -> void:
	var path := folder.plus_file(frame_name)
	var described := _read_object(path + ".json")
	name = frame_name
	type = LudusWire.Type[described["frame"]]
	content = described["content"]
	token = described.get("token", "")
	frame = _read_bytes(path + ".bin")
	if described.has("spec"):
		spec = _read_object(folder.plus_file(described["spec"]) + ".json")["content"]


## Returns the names of all golden frames.
static func names(folder: String) -> Array:
	var found := []
	var directory := Directory.new()
	if directory.open(folder) != OK or directory.list_dir_begin(true) != OK:
		return found
	var file := directory.get_next()
	while not file.empty():
		if file.ends_with(".json") and not directory.current_is_dir():
			found.append(file.trim_suffix(".json"))
		file = directory.get_next()
	found.sort()
	return found


## The frame without its header.
func payload() -> PoolByteArray:
	if frame.size() == LudusWire.HEADER_BYTES:
		return PoolByteArray()
	return frame.subarray(LudusWire.HEADER_BYTES, -1)


static func _read_bytes(path: String) -> PoolByteArray:
	var file := File.new()
	if file.open(path, File.READ) != OK:
		return PoolByteArray()
	return file.get_buffer(file.get_len())


static func _read_object(path: String) -> Dictionary:
	return JSON.parse(_read_bytes(path).get_string_from_utf8()).result
