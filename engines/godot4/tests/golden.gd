extends RefCounted
## One golden frame of [code]protocol/golden[/code] (see its README).

const LudusWire := preload("res://addons/ludus/bridge/wire.gd")

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
var frame: PackedByteArray


## Reads a golden frame.
static func read(folder: String, frame_name: String) -> RefCounted:
	var golden: RefCounted = new()
	var path := folder.path_join(frame_name)
	var described: Dictionary = JSON.parse_string(FileAccess.get_file_as_string(path + ".json"))
	golden.set("name", frame_name)
	golden.set("type", LudusWire.Type[described["frame"]])
	golden.set("content", described["content"])
	golden.set("token", described.get("token", ""))
	golden.set("frame", FileAccess.get_file_as_bytes(path + ".bin"))
	if described.has("spec"):
		var spec_path := folder.path_join(str(described["spec"]) + ".json")
		var whole: Dictionary = JSON.parse_string(FileAccess.get_file_as_string(spec_path))
		golden.set("spec", whole["content"])
	return golden


## Returns the names of all golden frames.
static func names(folder: String) -> PackedStringArray:
	var found := PackedStringArray()
	for file: String in DirAccess.get_files_at(folder):
		if file.ends_with(".json"):
			found.append(file.trim_suffix(".json"))
	return found


## The frame without its header.
func payload() -> PackedByteArray:
	return frame.slice(LudusWire.HEADER_BYTES)
