extends SceneTree
## Sends back what it gets, over a bare blocking socket: the floor under every round trip.
## Arguments: address, bytes per request, bytes per answer.


func _initialize() -> void:
	var arguments := OS.get_cmdline_user_args()
	var stream := _connect(arguments[0])
	var request_bytes := arguments[1].to_int()
	var answer := PackedByteArray()
	answer.resize(arguments[2].to_int())
	while stream.get_data(request_bytes)[0] == OK:
		stream.put_data(answer)
	quit()


func _connect(address: String) -> StreamPeer:
	var stream: StreamPeer = StreamPeerTCP.new()
	if address.begins_with("unix:"):
		stream = ClassDB.instantiate(&"StreamPeerUDS")
		stream.call(&"connect_to_host", address.trim_prefix("unix:"))
	else:
		var port := address.get_slice(":", 2).to_int()
		(stream as StreamPeerTCP).connect_to_host(address.get_slice(":", 1), port)
	while stream.call(&"get_status") == StreamPeerTCP.STATUS_CONNECTING:
		stream.call(&"poll")
		OS.delay_msec(1)
	if stream is StreamPeerTCP:
		(stream as StreamPeerTCP).set_no_delay(true)
	return stream
