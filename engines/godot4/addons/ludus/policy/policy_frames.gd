extends RefCounted
## The last observations of the slots of a policy that looks at several together (POLICY.md §3.1).

const LudusPolicyReader := preload("res://addons/ludus/policy/policy_reader.gd")

var _num_frames: int
## Bytes of one frame of each entry.
var _sizes: PackedInt32Array = []
## All frames of all slots, of each entry.
var _frames: Array[PackedByteArray] = []
## Whether a slot has seen nothing of its episode yet.
var _is_first: PackedByteArray = []


## Takes what was read of the policy.
func _init(read: LudusPolicyReader) -> void:
	_num_frames = read.frames
	for entry: LudusObservationEntry in read.entries:
		_sizes.append(entry.num_bytes())
		_frames.append(PackedByteArray())


## Gives room for [param num_slots] slots.
func reserve(num_slots: int) -> void:
	while _is_first.size() < num_slots:
		_is_first.append(1)


## Begins the episode of a slot: its first observation takes the places of those before.
func begin(slot: int) -> void:
	_is_first[slot] = 1


## Takes what all slots observe, for each entry of the policy; returns all frames in its place, the
## oldest first. What [param slots] observe belongs to their episodes.
func push(observed: Array[PackedByteArray], slots: PackedInt32Array) -> Array[PackedByteArray]:
	if _num_frames == 1:
		return observed
	for i: int in observed.size():
		_frames[i] = _push(observed[i], _frames[i], _sizes[i])
	for slot: int in slots:
		_is_first[slot] = 0
	return _frames


func _push(observed: PackedByteArray, old: PackedByteArray, size: int) -> PackedByteArray:
	var frames := PackedByteArray()
	for slot: int in _is_first.size():
		var newest := observed.slice(slot * size, (slot + 1) * size)
		if _is_first[slot] == 1:
			for i: int in _num_frames - 1:
				frames.append_array(newest)
		else:
			var first := slot * _num_frames * size
			frames.append_array(old.slice(first + size, first + _num_frames * size))
		frames.append_array(newest)
	return frames
