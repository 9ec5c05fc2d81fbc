extends Reference
## A message as godobuf's compiler makes them, written by hand:
## [code]Message { AgentData { float place = 1; repeated sint32 frames = 2; } = 1; WorldData { bool
## is_far = 1; } = 2; }[/code]


class AgentData:
	var _place: float = 0.0
	var _frames: Array = []

	func set_place(value: float) -> void:
		_place = value

	func add_frames(value: int) -> void:
		_frames.append(value)

	func to_bytes() -> PoolByteArray:
		var packed := PoolByteArray()
		for value in _frames:
			packed.append_array(varint(value << 1 ^ value >> 31))
		var out := StreamPeerBuffer.new()
		out.put_u8(1 << 3 | 5)
		out.put_float(_place)
		var bytes := out.data_array
		bytes.append(2 << 3 | 2)
		bytes.append_array(varint(packed.size()))
		bytes.append_array(packed)
		return bytes

	static func varint(value: int) -> PoolByteArray:
		var bytes := PoolByteArray()
		while value > 127:
			bytes.append(value & 127 | 128)
			value >>= 7
		bytes.append(value)
		return bytes


class WorldData:
	var _is_far: bool = false

	func set_is_far(value: bool) -> void:
		_is_far = value

	func to_bytes() -> PoolByteArray:
		return PoolByteArray([1 << 3, 1 if _is_far else 0])


class Message:
	var _parts: Dictionary = {}

	func new_agent_data() -> AgentData:
		_parts[1] = AgentData.new()
		return _parts[1]

	func new_world_data() -> WorldData:
		_parts[2] = WorldData.new()
		return _parts[2]

	func to_bytes() -> PoolByteArray:
		var out := PoolByteArray()
		for number in _parts:
			var bytes: PoolByteArray = _parts[number].to_bytes()
			out.append_array(PoolByteArray([number << 3 | 2, bytes.size()]))
			out.append_array(bytes)
		return out
