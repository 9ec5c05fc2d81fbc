class_name AIServerTCP
extends Node

## Stands for godot-ai's class in tests: asks the server at the port that the command line names.

const FOLDER = "AIServerCommFiles"

var _peer = StreamPeerTCP.new()


func connect_to_server(port: int):
	_peer.connect_to_host("127.0.0.1", port)
	while _peer.get_status() == StreamPeerTCP.STATUS_CONNECTING:
		_peer.poll()
		await get_tree().process_frame


## Sends an object; collects bytes until they parse as one.
func ask(message: Dictionary) -> Dictionary:
	_peer.put_data(JSON.stringify(message).to_utf8_buffer())
	var text = ""
	var json = JSON.new()
	while true:
		_peer.poll()
		var count = _peer.get_available_bytes()
		if count > 0:
			text += _peer.get_utf8_string(count)
			if json.parse(text) == OK:
				break
		elif _peer.get_status() != StreamPeerTCP.STATUS_CONNECTED:
			printerr("the server has gone")
			get_tree().quit(1)
			return {}
		OS.delay_usec(100)
	var answer: Dictionary = json.data
	if answer.has("error"):
		printerr(answer["error"])
	return answer


func write_file(file_name: String, data: Dictionary) -> String:
	var path = FOLDER + "/" + file_name
	DirAccess.make_dir_absolute("res://" + FOLDER)
	var file = FileAccess.open("res://" + path, FileAccess.WRITE)
	file.store_string(JSON.stringify(data))
	file.close()
	return path


func read_file(path: String) -> Dictionary:
	return JSON.parse_string(FileAccess.get_file_as_string("res://" + path))
