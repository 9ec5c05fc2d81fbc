tool
# The names in camelCase are GymGodot's: scenes set them.
# gdlint: disable=class-variable-name
class_name LudusGymGodot, "res://addons/ludus/icons/ludus_agent.svg"
extends LudusAgent
## The node of GymGodot, for environments that were written for it.
##
## It has the same properties, and the environment the same five methods; but Ludus trains it, in
## any number of worlds. GymGodot's scenes do not say what an action is: set [member discrete_n] or
## [member continuous_size]. What is observed is taken from the first observation. Started as
## GymGodot's Python starts games ([code]--serverPort=8000[/code]), it speaks GymGodot's wire
## instead. Otherwise the scene runs on its own, as it does with [member enabled] off.

const SOCKET_NAME := "WebSocketClient"
const Socket := preload("res://addons/ludus_classic/gym_godot_socket.gd")

## Frames of a step. The action is applied in each of them.
export(int, 1, 1000) var stepLength: int = 2 setget set_step_length
## The node with the five methods: [code]apply_action(action: Array)[/code],
## [code]get_observation() -> Array[/code], [code]get_reward() -> float[/code],
## [code]reset()[/code] and [code]is_done() -> bool[/code].
export var environmentNode: NodePath setget set_environment_node
## Print actions and what they lead to.
export var debugPrint: bool = false
## The action is a choice, 0 to so many minus one; as [code]Discrete(n)[/code] in Python.
export(int, 0, 1048576) var discrete_n: int = 0 setget set_discrete_n
## The action is so many numbers; as [code]Box(low, high, (size,))[/code] in Python.
export(int, 0, 65536) var continuous_size: int = 0 setget set_continuous_size
## Smallest value of each number.
export var low: float = -1.0
## Largest value of each number.
export var high: float = 1.0

var _environment: Node
var _has_reset: bool = false
## Whether the state after the last action has been looked at.
var _has_looked: bool = false
var _observation: Array = []
var _reward: float = 0.0
var _is_done: bool = false


## A scene that puts GymGodot together by hand has a child that quits when nobody listens.
func _ready() -> void:
	if Engine.editor_hint:
		return
	if has_node(SOCKET_NAME):
		get_node(SOCKET_NAME).free()
	if enabled and Socket.is_wanted():
		_open_socket()


func set_step_length(value: int) -> void:
	stepLength = value
	ticks_per_step = value


func set_environment_node(value: NodePath) -> void:
	environmentNode = value
	update_configuration_warning()


func set_discrete_n(value: int) -> void:
	discrete_n = value
	update_configuration_warning()


func set_continuous_size(value: int) -> void:
	continuous_size = value
	update_configuration_warning()


## Finds the environment, target and world. Returns what is wrong, or an empty text.
func connect_to_game() -> String:
	var problem := _find_environment()
	if not problem.empty():
		return problem
	if action.empty():
		action = _declared_action()
	if action.empty():
		return "GymGodot does not say what an action is: set discrete_n or continuous_size"
	return .connect_to_game()


## Hands the action to the environment as a list, as GymGodot does; a choice is a list of one.
func apply_action(given) -> void:
	_has_looked = false
	var numbers := [given] if given is int else Array(given)
	if debugPrint:
		print("GYMGODOT : action %s" % [numbers])
	_environment.apply_action(numbers)


## Returns what the environment shows.
func get_observation() -> Array:
	if not _has_reset:
		return _environment.get_observation()
	_look()
	return _observation


## Returns the reward of the last step.
func get_reward() -> float:
	_look()
	return _reward


## Returns whether the episode has ended.
func is_done() -> bool:
	_look()
	return _is_done


## Begins an episode. Environments for GymGodot know only the global random numbers, so these follow
## the world's.
func reset() -> void:
	seed(world.rng.randi())
	_environment.reset()
	_has_reset = true
	_has_looked = true
	_observation = _environment.get_observation()
	_reward = 0.0
	_is_done = false


## Asks as GymGodot does: once a step, and in this order. Environments count on both.
func _look() -> void:
	if _has_looked:
		return
	_has_looked = true
	_observation = _environment.get_observation()
	_reward = _environment.get_reward()
	_is_done = _environment.is_done()
	if debugPrint:
		print("GYMGODOT : %s, reward %s, done %s" % [_observation, _reward, _is_done])


## Lets GymGodot's Python play: for Ludus, and for a policy in the game, the agent is switched off.
func _open_socket() -> void:
	var problem := _find_environment()
	if not problem.empty():
		push_error(problem)
		get_tree().quit(1)
		return
	set_enabled(false)
	var socket := Socket.new()
	socket.environment = _environment
	socket.step_length = stepLength
	socket.is_logging = debugPrint
	add_child(socket)


func _find_environment() -> String:
	_environment = null if environmentNode.is_empty() else get_node_or_null(environmentNode)
	if _environment == null:
		return "environmentNode '%s' leads nowhere" % environmentNode
	for method in REQUIRED_METHODS:
		if not _environment.has_method(method):
			return "%s has no method %s()" % [_describe(_environment), method]
	return ""


func _declared_action() -> Array:
	if discrete_n > 0:
		return [LudusActionComponent.discrete("action", discrete_n)]
	if continuous_size > 0:
		return [LudusActionComponent.continuous("action", continuous_size, low, high)]
	return []


func _get_configuration_warning() -> String:
	var warnings := PoolStringArray()
	var node := get_node_or_null(environmentNode) if not environmentNode.is_empty() else null
	if node == null:
		warnings.append("environmentNode leads nowhere.")
	elif node.get_script() != null:
		warnings.append_array(_method_warnings(node.get_script()))
	if action.empty() and discrete_n == 0 and continuous_size == 0:
		warnings.append(
			"GymGodot does not say what an action is: set discrete_n or continuous_size."
		)
	return warnings.join("\n")
