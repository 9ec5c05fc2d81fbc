extends LudusSimulation
## One soldier with a rifle against two zombies, in a room with one to four inner walls.
##
## All of the game is computed here, without nodes and without a physics space; see README.md for
## the rules. The drawing reads what it needs from [member soldier], [member zombies] and
## [member map].

## Emitted when a round is over: whether all zombies are dead, and whether the soldier is.
signal round_ended(has_soldier_won: bool, have_zombies_won: bool)

const Fighter := preload("res://examples/zombies/fighter.gd")
const Map := preload("res://examples/shared/walled_map.gd")
const Original := preload("res://examples/shared/original_rules.gd")
const OriginalRound := preload("res://examples/zombies/original_round.gd")
const Soldier := preload("res://examples/zombies/soldier.gd")
const Zombie := preload("res://examples/zombies/zombie.gd")

const SOLDIER_SETTINGS := preload("res://examples/zombies/soldier_settings.tres")
const ZOMBIE_SETTINGS := preload("res://examples/zombies/zombie_settings.tres")

const SOLDIER := "soldier"
const ZOMBIE := "zombie"
const NUM_ZOMBIES := 2
const MAX_WALLS := 4
## Lengths of the walls, pixels: on average half the map's radius.
const SHORTEST_WALL := 0.2 * Map.RADIUS
const LONGEST_WALL := 0.8 * Map.RADIUS
const NUM_ROUND_STEPS := 75
## Distance of each zombie from the soldier at the start, pixels.
const START_DISTANCE := 0.6 * Map.RADIUS
## World parameter: "change" (the default) rewards what the score has changed, "score" the score
## itself, in every step.
const REWARD_PARAMETER := "reward"
## World parameter: with "turn" (the default) the third number of an action turns from where one
## looks, with "angle" it is the angle in the room.
const ROTATION_PARAMETER := "rotation"

var map := Map.new()
var soldier := Soldier.new()
var zombies: Array[Zombie] = [Zombie.new(), Zombie.new()]
## Steps made in this round, and rounds begun.
var num_steps: int = 0
var num_rounds: int = 0
## Rounds that each team has won.
var num_soldier_wins: int = 0
var num_zombie_wins: int = 0
## Where a person aims the soldier, radians; set by the drawing.
var manual_aim: float = 0.0

var _fighters: Array[Fighter] = []
var _enemies: Array[Fighter] = []
## Whether actions have come that no tick has carried out yet.
var _is_pending: bool = false
var _rewards := PackedFloat64Array([0.0, 0.0, 0.0])
var _soldier_score: float = 0.0
var _zombie_score: float = 0.0
var _is_score_rewarded: bool = false
var _is_turn: bool = true
## Plays by the original's rules; null where ours hold.
var _original: OriginalRound


func _init() -> void:
	_enemies.assign(zombies)
	_fighters.append(soldier)
	_fighters.append_array(_enemies)


func policy_names() -> PackedStringArray:
	return [SOLDIER, ZOMBIE, ZOMBIE]


func observation_entries(policy_name: String) -> Array[LudusObservationEntry]:
	var size := Zombie.observation_size(Zombie.SENSES_SIZE, Zombie.ACTION_SIZE)
	if policy_name == SOLDIER:
		size = Soldier.observation_size(Soldier.SENSES_SIZE, Soldier.ACTION_SIZE)
	if Original.are_chosen(world):
		var is_soldier := policy_name == SOLDIER
		size = OriginalRound.observation_size(
			OriginalRound.SOLDIER_SENSES if is_soldier else OriginalRound.ZOMBIE_SENSES
		)
	var entry := LudusObservationEntry.create("observation", [size])
	entry.low = -1.0
	entry.high = 1.0
	return [entry]


func action_components(policy_name: String) -> Array[LudusActionComponent]:
	var size := Soldier.ACTION_SIZE if policy_name == SOLDIER else Zombie.ACTION_SIZE
	return [LudusActionComponent.continuous("act", size)]


func settings(policy_name: String) -> LudusPolicySettings:
	return SOLDIER_SETTINGS if policy_name == SOLDIER else ZOMBIE_SETTINGS


func max_episode_steps() -> int:
	return NUM_ROUND_STEPS


func begin_episode() -> void:
	num_steps = 0
	num_rounds += 1
	_is_pending = false
	_rewards.fill(0.0)
	if Original.are_chosen(world):
		_begin_originally()
	else:
		_begin()
	_soldier_score = soldier_score()
	_zombie_score = zombie_score()


func apply_action(agent: int, action: Variant) -> void:
	_fighters[agent].take_action(action)
	_is_pending = true


## Makes a step in the first tick after the actions: the soldier shoots where it looks, then all
## turn and walk, then zombies bite.
func advance() -> void:
	if not _is_pending or is_over():
		return
	_is_pending = false
	num_steps += 1
	for fighter: Fighter in _fighters:
		fighter.pain = 0.0
	if _original != null:
		_original.advance()
	else:
		_make_step()
	_reward()
	if is_over() or num_steps == NUM_ROUND_STEPS:
		_end_round()


func get_observation(agent: int) -> Variant:
	return _fighters[agent].observation


func get_reward(agent: int) -> float:
	var reward := _rewards[agent]
	_rewards[agent] = 0.0
	return reward


func is_done(_agent: int) -> bool:
	return is_over()


## Whether one team is dead.
func is_over() -> bool:
	return not soldier.is_alive() or _zombie_health() == 0.0


## Score of the soldier's team: −1 at the start, 27 when both zombies are dead.
func soldier_score() -> float:
	return pow(2.0 * (NUM_ZOMBIES - _zombie_health()) - 1.0, 3.0)


## Score of the zombies' team: −10 at the start, 10 when the soldier is dead.
func zombie_score() -> float:
	return 10.0 * (2.0 * (1.0 - soldier.health) - 1.0)


## Lets a person steer the soldier with W, A, S and D, the mouse, Space or a mouse button and R;
## with Shift the first zombie. Zombies that nobody steers walk towards the soldier.
func get_manual_action(agent: int) -> Variant:
	var x := float(Input.is_key_pressed(KEY_D)) - float(Input.is_key_pressed(KEY_A))
	var y := float(Input.is_key_pressed(KEY_S)) - float(Input.is_key_pressed(KEY_W))
	var is_shifted := Input.is_key_pressed(KEY_SHIFT)
	if agent == 0:
		var move := Vector2.ZERO if is_shifted else Vector2(x, y)
		var is_trigger := Input.is_key_pressed(KEY_SPACE)
		is_trigger = is_trigger or Input.is_mouse_button_pressed(MOUSE_BUTTON_LEFT)
		var reload := float(Input.is_key_pressed(KEY_R))
		var aim := _rotation_action(soldier, manual_aim)
		return PackedFloat32Array([move.x, move.y, aim, float(is_trigger), reload])
	var way := _fighters[agent].place.direction_to(soldier.place)
	var step := Vector2(x, y) if agent == 1 and is_shifted else way * 0.7
	return PackedFloat32Array([step.x, step.y, _rotation_action(_fighters[agent], way.angle())])


## What the panel shows.
func status() -> Dictionary:
	var rifle := "%d of %d" % [soldier.num_shots, Soldier.NUM_SHOTS]
	return {
		"Round": num_rounds,
		"Step": "%d of %d" % [num_steps, NUM_ROUND_STEPS],
		"Score of the soldier": "%+.1f" % soldier_score(),
		"Score of the zombies": "%+.1f" % zombie_score(),
		"Shots": "reloading" if soldier.reload_delay > 0 else rifle,
		"Soldier won": num_soldier_wins,
		"Zombies won": num_zombie_wins,
	}


func _begin() -> void:
	_is_score_rewarded = world.parameters.get(REWARD_PARAMETER, "change") == "score"
	_is_turn = world.parameters.get(ROTATION_PARAMETER, "turn") == "turn"
	map.build(world.rng, world.rng.randi_range(1, MAX_WALLS), SHORTEST_WALL, LONGEST_WALL)
	_place_all(world.rng)
	_observe()


func _begin_originally() -> void:
	_is_score_rewarded = true
	_is_turn = false
	if _original == null:
		_original = OriginalRound.new(map, soldier, zombies)
	_original.begin(world.rng)


func _make_step() -> void:
	var hit := soldier.use_rifle(map, _enemies)
	if hit != null:
		hit.suffer(Soldier.DAMAGE)
	soldier.act(map, Soldier.STEP_LENGTH, _is_turn)
	for zombie: Zombie in zombies:
		zombie.act(map, Zombie.STEP_LENGTH, _is_turn)
	for zombie: Zombie in zombies:
		zombie.bite(map, soldier)
	_observe()


func _end_round() -> void:
	var is_soldier_dead := not soldier.is_alive()
	var are_zombies_dead := _zombie_health() == 0.0
	num_soldier_wins += int(are_zombies_dead and not is_soldier_dead)
	num_zombie_wins += int(is_soldier_dead and not are_zombies_dead)
	round_ended.emit(are_zombies_dead, is_soldier_dead)


## Returns the number of an action after which [param fighter] looks to an angle, radians.
func _rotation_action(fighter: Fighter, angle: float) -> float:
	return wrapf(angle - (fighter.rotation if _is_turn else 0.0), -PI, PI) / PI


func _place_all(rng: RandomNumberGenerator) -> void:
	var start := map.free_place(rng, Fighter.RADIUS, [], 0.0)
	soldier.begin(start, rng.randf_range(-PI, PI))
	for zombie: Zombie in zombies:
		var at := map.free_place(rng, Fighter.RADIUS, [start], START_DISTANCE)
		zombie.begin(at, rng.randf_range(-PI, PI))


func _zombie_health() -> float:
	var sum := 0.0
	for zombie: Zombie in zombies:
		sum += zombie.health
	return sum


func _reward() -> void:
	var scores := Vector2(soldier_score(), zombie_score())
	var earned := scores
	if not _is_score_rewarded:
		earned -= Vector2(_soldier_score, _zombie_score)
	_soldier_score = scores.x
	_zombie_score = scores.y
	_rewards[0] += earned.x
	for i: int in NUM_ZOMBIES:
		_rewards[1 + i] += earned.y


func _observe() -> void:
	var soldiers := PackedVector2Array([soldier.place] if soldier.is_alive() else [])
	soldier.observe(map, Fighter.places_of(_enemies))
	for i: int in NUM_ZOMBIES:
		var friend := zombies[1 - i]
		var friends := PackedVector2Array([friend.place] if friend.is_alive() else [])
		zombies[i].observe(map, soldiers, friends)
