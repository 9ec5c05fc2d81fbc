class_name LudusPolicyFrames
extends Reference
## The last observations of the slots of a policy that looks at several together (POLICY.md §3.1).

var _num_frames: int
## All frames of all slots, by entry.
var _frames: Dictionary = {}
## Whether a slot has seen nothing of its episode yet.
var _is_first: Array = []


## Takes the number of frames.
func _init(num_frames: int) -> void:
	_num_frames = num_frames


## Gives room for [param num_slots] slots.
func reserve(num_slots: int) -> void:
	while _is_first.size() < num_slots:
		_is_first.append(true)


## Begins the episode of a slot: its first observation takes the places of those before.
func begin(slot: int) -> void:
	_is_first[slot] = true


## Takes what all slots observe of one entry, [param size] numbers each, as an Array or a
## PoolByteArray; returns all frames in its place, the oldest first.
func push(entry: int, observed, size: int):
	if _num_frames == 1:
		return observed
	var frames = PoolByteArray() if observed is PoolByteArray else []
	for slot in _is_first.size():
		var newest = _part(observed, slot * size, size)
		if _is_first[slot]:
			for _i in _num_frames - 1:
				frames.append_array(newest)
		else:
			var first: int = (slot * _num_frames + 1) * size
			frames.append_array(_part(_frames[entry], first, (_num_frames - 1) * size))
		frames.append_array(newest)
	_frames[entry] = frames
	return frames


## Notes that what [param slots] have observed belongs to their episodes.
func end_step(slots: Array) -> void:
	for slot in slots:
		_is_first[slot] = false


static func _part(numbers, first: int, count: int):
	if numbers is PoolByteArray:
		return numbers.subarray(first, first + count - 1)
	return numbers.slice(first, first + count - 1)
