class_name LudusClassicSimulation
extends LudusSimulation
## A [BaseSimulation] as a [LudusSimulation]: one world of an [AIBaseEnvironment].
##
## As in godot-ai every round is played by a new simulation, a step is two ticks, and an agent whose
## game is complete waits for the end of the round.

## What [method BaseSimulation.new_game] may await.
signal physics_update

## Ticks of a step, and ticks that pass between [method BaseSimulation.new_game] and the first step.
const NUM_TICKS := 2

## Of the environment on show.
static var runner: AIRunner

## The game of this round; null before the first one and after the last one.
var game: BaseSimulation

## Whether the game has begun.
var _has_begun: bool = false
## Agents whose decision of this step was applied.
var _has_acted: PackedByteArray = []
## Agents whose game is complete.
var _is_over: PackedByteArray = []


func policy_names() -> PackedStringArray:
	if runner == null:
		push_error("ludus: worlds of ludus_classic need the scene of their AIBaseEnvironment")
		return []
	return runner.agents()


func observation_entries(policy_name: String) -> Array[LudusObservationEntry]:
	return [runner.observation_entry(policy_name)]


func action_components(policy_name: String) -> Array[LudusActionComponent]:
	return [runner.action_component(policy_name)]


func settings(policy_name: String) -> LudusPolicySettings:
	return runner.settings(policy_name)


func ticks_per_step() -> int:
	return NUM_TICKS


func max_episode_steps() -> int:
	return runner.env_delegate.get_steps_in_round()


func create() -> void:
	runner.simulations.append(self)


func begin_episode() -> void:
	_end_game()
	game = runner.new_simulation()
	_has_acted.resize(runner.agents().size())
	_has_acted.fill(0)
	_is_over = _has_acted.duplicate()
	ticked.connect(_tick)
	_begin_game()
	while not _has_begun:
		await ticked
	ticked.disconnect(_tick)
	for i: int in NUM_TICKS:
		await ticked


func apply_action(agent: int, action: Variant) -> void:
	if _has_acted[agent] == 1:
		return
	_has_acted[agent] = 1
	var vector: Array[float] = []
	vector.assign(Array(action as PackedFloat32Array))
	_seed()
	game.apply_action(agent, vector, null)


func get_reward(agent: int) -> float:
	_has_acted[agent] = 0
	_is_over[agent] = int(game.is_game_complete(agent))
	return game.get_score(agent)


func is_done(agent: int) -> bool:
	return _is_over[agent] == 1


func get_observation(agent: int) -> Variant:
	return PackedFloat32Array(game.get_state(agent))


func clean_up() -> void:
	_end_game()
	if is_instance_valid(runner):
		runner.simulations.erase(self)


func describe() -> String:
	return (game.get_script() as Script).resource_path if game != null else super()


## Ends the game of this round.
func _end_game() -> void:
	if game == null:
		return
	# A game that still awaits this signal would keep itself alive.
	for connection: Dictionary in physics_update.get_connections():
		physics_update.disconnect(connection["callable"] as Callable)
	game.cleanup_simulation()
	game = null


## An [code]await[/code] of the game itself would leak if the engine ended meanwhile.
func _begin_game() -> void:
	_has_begun = false
	_seed()
	var beginning: Variant = game.call(&"new_game", physics_update)
	if beginning is Object:
		(beginning as Object).connect(&"completed", _note_beginning.unbind(1))
	else:
		_note_beginning()


func _note_beginning() -> void:
	_has_begun = true


func _tick() -> void:
	_seed()
	physics_update.emit()


## Games for godot-ai draw from the global random stream, which all worlds share. Begun anew from
## the world's own wherever a game decides something, it makes equal seeds give equal rounds.
func _seed() -> void:
	seed(world.rng.randi())
