extends LudusAgent
## Makes an AIController of Godot RL Agents, its parent, an agent.
##
## The controller is the game's own copy of the original, of any version, so that it is asked by
## name.

const LudusCameras := preload("res://addons/ludus/cameras/cameras.gd")
const DEFAULT_POLICY := "shared_policy"
## Observations with this in their name are images, which come as hexadecimal digits.
const IMAGE_MARK := "2d"

## Tick in which cameras have drawn last: those of all agents do so together.
static var _drawn_tick: int = -1

var _controller: Node
## Number of values of each discrete entry of the observation.
var _num_choices: Dictionary[String, int] = {}
## Name of the only entry, if that is one list of numbers.
var _flat_entry: String = ""
## Whether the elements of an observation have been looked at once, which costs more than the rest.
var _is_checked: bool = false
var _mistake: String = ""
## Whether the game has begun the next episode by itself, as it does after an end.
var _has_begun: bool = false
## Whether no action has been taken since the episode began.
var _is_first_step: bool = false
## Whether the time limit of the controller was within reach already before this step.
var _was_late: bool = false


func _init(controller: Node, ticks: int) -> void:
	_controller = controller
	name = "LudusAgent"
	ticks_per_step = ticks
	action_timing = ActionTiming.ONCE
	var own_name: Variant = controller.get(&"policy_name")
	policy_name = DEFAULT_POLICY if own_name == null else str(own_name)
	_declare_observation(_space(&"get_obs_space"))
	_declare_action(_space(&"get_action_space"))
	controller.add_child(self)


func connect_to_game() -> String:
	return super() if _mistake.is_empty() else "%s: %s" % [_describe(_controller), _mistake]


func apply_action(decided: Variant) -> void:
	if _is_first_step:
		_begin_counting()
	_controller.call(&"set_action", _by_name(decided))


## The observation: its only list of numbers, or all entries by name.
func get_observation() -> Variant:
	if is_in_group(LudusCameras.DRAWN_GROUP):
		_draw_once()
	var seen: Dictionary = _controller.call(&"get_obs")
	if not _is_checked:
		_is_checked = true
	elif not _flat_entry.is_empty():
		return PackedFloat32Array(seen.get(_flat_entry))
	var entries := {}
	for entry: LudusObservationEntry in observation:
		entries[entry.name] = _convert(entry, seen.get(entry.name))
	return entries


func get_reward() -> float:
	var reward: float = _controller.call(&"get_reward")
	_controller.call(&"zero_reward")
	return reward


func is_done() -> bool:
	if not _controller.call(&"get_done"):
		return false
	_controller.call(&"set_done_false")
	_has_begun = true
	return true


## Whether the controller's [code]reset_after[/code] ticks will be over within the next step: it
## would begin again without telling what it observed last.
func is_truncated() -> bool:
	var num_ticks: Variant = _controller.get(&"n_steps")
	var limit: Variant = _controller.get(&"reset_after")
	var is_late: bool = num_ticks != null and limit != null and num_ticks + ticks_per_step >= limit
	var is_reached := is_late and not _was_late
	_was_late = is_late
	return is_reached


## Asks the game to begin again in its next tick, unless it has by itself.
func reset() -> void:
	if not _has_begun:
		_controller.set(&"needs_reset", true)
	_has_begun = false
	_is_first_step = true
	_was_late = false


## Takes control, and forgets rewards and ends of the time before.
func _begin_counting() -> void:
	_is_first_step = false
	_controller.call(&"set_heuristic", "model")
	_controller.call(&"zero_reward")
	_controller.call(&"set_done_false")


## An action as the game knows it: a choice is an [int], numbers are an [Array].
func _by_name(decided: Variant) -> Dictionary:
	var named := {}
	var next := 0
	for part: LudusActionComponent in action:
		var value: Variant = decided
		if decided is Dictionary:
			value = decided[part.name]
		elif decided is PackedFloat32Array:
			value = (decided as PackedFloat32Array).slice(next, next + part.size)
			next += part.size
		elif decided is PackedInt64Array:
			value = decided[next]
			next += 1
		named[part.name] = Array(value) if value is PackedFloat32Array else value
	return named


func _convert(entry: LudusObservationEntry, value: Variant) -> Variant:
	if value is String:
		return _opaque(entry, (value as String).hex_decode())
	if _num_choices.has(entry.name):
		return _one_hot(_num_choices[entry.name], value)
	return _flatten(value) if value is Array and entry.shape.size() > 1 else value


## Keeps the viewports of cameras drawn, which the engine leaves out where nobody sees the scene.
func _let_draw() -> void:
	var world := LudusWorld.find_above(_controller)
	if world == null:
		return
	for viewport: SubViewport in world.root.find_children("*", "SubViewport", true, false):
		viewport.render_target_update_mode = SubViewport.UPDATE_ALWAYS
		add_to_group(LudusCameras.DRAWN_GROUP)


static func _draw_once() -> void:
	var tick := Engine.get_physics_frames()
	if _drawn_tick != tick and LudusCameras.has_renderer():
		_drawn_tick = tick
		LudusCameras.draw_all()


## The picture without the alpha channel that OpenGL draws, where the controller declares none.
static func _opaque(entry: LudusObservationEntry, pixels: PackedByteArray) -> PackedByteArray:
	var shape := entry.shape
	if shape.size() != 3 or shape[2] != 3 or pixels.size() != 4 * shape[0] * shape[1]:
		return pixels
	var picture := Image.create_from_data(shape[1], shape[0], false, Image.FORMAT_RGBA8, pixels)
	picture.convert(Image.FORMAT_RGB8)
	return picture.get_data()


static func _one_hot(num_choices: int, value: Variant) -> Variant:
	var choice: Variant = value[0] if value is Array and len(value) == 1 else value
	if (choice is not int and choice is not float) or choice < 0 or choice >= num_choices:
		return value
	var chosen := PackedFloat32Array()
	chosen.resize(num_choices)
	chosen[int(choice)] = 1.0
	return chosen


static func _flatten(values: Array) -> Array:
	var flat := []
	for value: Variant in values:
		if value is Array:
			flat.append_array(_flatten(value))
		else:
			flat.append(value)
	return flat


## What the controller declares: an unfinished one, or one whose script has failed, says nothing.
func _space(method: StringName) -> Dictionary:
	var space: Variant = _controller.call(method)
	if space is Dictionary and not (space as Dictionary).is_empty():
		return space
	if _mistake.is_empty():
		_mistake = "%s() returns %s, expected at least one entry" % [method, str(space)]
	return {}


func _declare_observation(space: Dictionary) -> void:
	for key: String in space:
		var part: Dictionary = space[key]
		var shape := _shape(part.get("size"))
		if shape.is_empty():
			_mistake = 'get_obs_space(): "%s" has no size' % key
			return
		var entry := LudusObservationEntry.create(key, shape)
		if part.get("space") == "discrete":
			_num_choices[key] = entry.size()
			entry.shape = [entry.size()]
			entry.low = 0.0
			entry.high = 1.0
		elif IMAGE_MARK in key:
			entry.dtype = LudusObservationEntry.DType.UINT8
			_let_draw()
			if shape.size() == 3:  # declared with the channels first, sent with them last
				entry.shape = [shape[1], shape[2], shape[0]]
		else:
			entry.low = part.get("low", -INF)
			entry.high = part.get("high", INF)
			_flat_entry = key if space.size() == 1 and shape.size() == 1 else ""
		observation.append(entry)


func _declare_action(space: Dictionary) -> void:
	for key: String in space:
		var size := _shape(space[key].get("size"))
		if size.size() != 1:
			_mistake = 'get_action_space(): "%s" has no size' % key
			return
		if space[key].get("action_type") == "discrete":
			action.append(LudusActionComponent.discrete(key, size[0]))
		else:
			action.append(LudusActionComponent.continuous(key, size[0]))


## The shape that a size declares, which is a number or a list of some.
static func _shape(size: Variant) -> PackedInt32Array:
	var sizes: Array = size if size is Array else [size]
	for length: Variant in sizes:
		if (length is not int and length is not float) or length < 1:
			return PackedInt32Array()
	return PackedInt32Array(sizes)
