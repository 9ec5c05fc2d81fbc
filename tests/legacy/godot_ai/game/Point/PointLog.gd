class_name PointLog
extends RefCounted

## Writes down what happens, one line each, into the file that the environment variable names.

static var _file: FileAccess
static var _is_open = false


static func write(words: String):
	if !_is_open:
		_is_open = true
		var path = OS.get_environment("POINT_LOG")
		if !path.is_empty():
			_file = FileAccess.open(path, FileAccess.WRITE)
	if _file:
		_file.store_line(words)
		_file.flush()
