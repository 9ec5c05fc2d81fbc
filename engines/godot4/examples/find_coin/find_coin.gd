extends LudusSimulation
## A hero looks for a target that runs away, in a room with one inner wall.
##
## All of the game is computed here, without nodes and without a physics space; see README.md for
## the rules. The drawing reads what it needs from [member hero], [member target] and [member map].

## Emitted when a round is over: whether the hero touched the target, and after how many steps.
signal round_ended(is_found: bool, num_steps: int)

const Map := preload("res://examples/shared/walled_map.gd")
const Original := preload("res://examples/shared/original_rules.gd")
const Walker := preload("res://examples/shared/walker.gd")

const HERO_SETTINGS := preload("res://examples/find_coin/hero_settings.tres")
const TARGET_SETTINGS := preload("res://examples/find_coin/target_settings.tres")

const HERO := "hero"
const TARGET := "target"
## Angles of the rays from straight ahead, fractions of π.
const RAY_ANGLES: PackedFloat64Array = [0.0, 0.1, -0.1, 0.21, -0.21, 0.33, -0.33, 0.45, -0.45]
const NUM_RAYS := 9
## Where the rays to the other one begin among the senses.
const OTHER_AT := 1 + NUM_RAYS
## Rotation, rays to walls, rays to the other one, place.
const SENSES_SIZE := 1 + 2 * NUM_RAYS + 2
const ACTION_SIZE := 2
const NUM_ROUND_STEPS := 60
## Pixels that a body moves in a step for each unit of its action, by agent.
const STEP_LENGTHS: PackedFloat64Array = [20.0, 1.2 * 20.0]
## Length of the inner wall by the original's rules, pixels at least.
const ORIGINAL_WALL := 0.75 * Original.REACH
## Distance of the centres at which two bodies touch, pixels.
const CONTACT := 2.0 * Walker.RADIUS
## What a touching body reads as on all rays: this times its distance.
const TOUCH_SHARE := 0.2

static var _fan := Walker.fan(RAY_ANGLES)

var map := Map.new()
var hero := Walker.new(SENSES_SIZE, ACTION_SIZE)
var target := Walker.new(SENSES_SIZE, ACTION_SIZE)
## Whether hero and target touch: the round is over.
var is_found: bool = false
## Steps made in this round, and rounds begun.
var num_steps: int = 0
var num_rounds: int = 0
## Rounds in which the hero touched the target.
var num_found: int = 0

var _walkers: Array[Walker] = [hero, target]
## Whether actions have come that no tick has carried out yet.
var _is_pending: bool = false
var _rewards := PackedFloat64Array([0.0, 0.0])
## Whether the original's rules hold.
var _is_original: bool = false


func policy_names() -> PackedStringArray:
	return [HERO, TARGET]


func observation_entries(_policy_name: String) -> Array[LudusObservationEntry]:
	var size := Walker.observation_size(SENSES_SIZE, ACTION_SIZE)
	var entry := LudusObservationEntry.create("observation", [size])
	entry.low = -1.0
	entry.high = 1.0
	return [entry]


func action_components(_policy_name: String) -> Array[LudusActionComponent]:
	return [LudusActionComponent.continuous("move", ACTION_SIZE)]


func settings(policy_name: String) -> LudusPolicySettings:
	return HERO_SETTINGS if policy_name == HERO else TARGET_SETTINGS


func max_episode_steps() -> int:
	return NUM_ROUND_STEPS


func begin_episode() -> void:
	_is_original = Original.are_chosen(world)
	if _is_original:
		_build_original_wall()
	else:
		map.build(world.rng, 1)
	hero.begin(_draw_start([]), world.rng.randf_range(-PI, PI))
	target.begin(_draw_start([hero.place]), world.rng.randf_range(-PI, PI))
	is_found = false
	num_steps = 0
	num_rounds += 1
	_is_pending = false
	_rewards.fill(0.0)
	_sense()


func apply_action(agent: int, action: Variant) -> void:
	_walkers[agent].take_action(action)
	_is_pending = true


## Makes the step of both in the first tick after their actions; the other ticks are for the eye.
func advance() -> void:
	if not _is_pending or is_found:
		return
	_is_pending = false
	num_steps += 1
	for agent: int in 2:
		_move(_walkers[agent], STEP_LENGTHS[agent])
	var distance := hero.place.distance_to(target.place)
	is_found = distance < CONTACT if _is_original else distance <= CONTACT
	_rewards[0] += 1.0 if is_found else -1.0
	_rewards[1] += -1.0 if is_found else 1.0
	_sense()
	num_found += int(is_found)
	if is_found or num_steps == NUM_ROUND_STEPS:
		round_ended.emit(is_found, num_steps)


func get_observation(agent: int) -> Variant:
	return _walkers[agent].observation


func get_reward(agent: int) -> float:
	var reward := _rewards[agent]
	_rewards[agent] = 0.0
	return reward


func is_done(_agent: int) -> bool:
	return is_found


## Lets a person steer: W, A, S and D move the hero, with Shift the target.
func get_manual_action(agent: int) -> Variant:
	var is_meant := Input.is_key_pressed(KEY_SHIFT) == (agent == 1)
	var x := float(Input.is_key_pressed(KEY_D)) - float(Input.is_key_pressed(KEY_A))
	var y := float(Input.is_key_pressed(KEY_S)) - float(Input.is_key_pressed(KEY_W))
	return PackedFloat32Array([x, y]) if is_meant else PackedFloat32Array([0.0, 0.0])


## What the panel shows.
func status() -> Dictionary:
	var score := 2 - num_steps if is_found else -num_steps
	return {
		"Round": num_rounds,
		"Step": "%d of %d" % [num_steps, NUM_ROUND_STEPS],
		"Score of the hero": "%+d" % score,
		"Score of the coin": "%+d" % -score,
		"Found": "%d of %d" % [num_found, num_rounds - int(not is_found)],
	}


## A wall without thickness anywhere, which may close a passage.
func _build_original_wall() -> void:
	map.clear()
	map.half_thickness = 0.0
	map.gap = 0.0
	map.stops_overlapping = false
	while map.ends.is_empty():
		var from := Original.draw_point(world.rng)
		var to := Original.draw_point(world.rng)
		if from.distance_to(to) >= ORIGINAL_WALL:
			map.add_wall(from, to)


func _draw_start(others: PackedVector2Array) -> Vector2:
	if _is_original:
		return Original.draw_start(world.rng, map, others, Map.RADIUS)
	return map.free_place(world.rng, Walker.RADIUS, others, Map.RADIUS)


func _move(walker: Walker, step_length: float) -> void:
	var motion := Vector2(walker.action[0], walker.action[1])
	if _is_original:
		walker.rotation = motion.angle()  # 0 without motion
		walker.place = Original.move(map, walker.place, motion * step_length)
		return
	if motion != Vector2.ZERO:
		walker.rotation = motion.angle()
	walker.walk(map, step_length)


func _sense() -> void:
	_sense_one(hero, target)
	_sense_one(target, hero)


func _sense_one(walker: Walker, other: Walker) -> void:
	if _is_original:
		_sense_originally(walker, other)
		return
	walker.look(map, _fan)
	var senses := PackedFloat32Array()
	senses.resize(SENSES_SIZE)
	senses[0] = walker.rotation / PI
	for i: int in NUM_RAYS:
		senses[1 + i] = walker.ray_lengths[i] / Walker.SIGHT
		senses[OTHER_AT + i] = 1.0
	var distance := walker.place.distance_to(other.place)
	if distance > CONTACT:
		walker.see([other.place], senses, OTHER_AT)
	else:
		for i: int in NUM_RAYS:
			senses[OTHER_AT + i] = TOUCH_SHARE * distance / Walker.SIGHT
	senses[SENSES_SIZE - 2] = walker.place.x / Map.RADIUS
	senses[SENSES_SIZE - 1] = walker.place.y / Map.RADIUS
	walker.remember(senses)


func _sense_originally(walker: Walker, other: Walker) -> void:
	var walls := Original.look(map, walker, RAY_ANGLES)
	var senses := PackedFloat32Array([walker.rotation / PI])
	senses.append_array(walls)
	senses.append_array(Original.see(walker, walls, [other.place], true))
	senses.append(walker.place.x / Map.RADIUS)
	senses.append(walker.place.y / Map.RADIUS)
	Original.remember(walker, senses, Walker.NUM_REMEMBERED * ACTION_SIZE)
