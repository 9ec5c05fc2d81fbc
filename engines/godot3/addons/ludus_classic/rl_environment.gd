class_name RLEnvironment
extends Spatial
## The root of a game for godot_gym_api: serves a client, and lets the game run for each of its
## steps.
##
## A script that extends it sets [member agent] and [member world] in [code]_ready[/code], calls
## [code]communication.start_server(9090, "127.0.0.1")[/code] there, and overrides [method _reset].
## Between two steps the game is paused. Methods that a script may override have the signatures of
## the original.

const CONFIG_KEY := "config"
const RESET_KEY := "reset"
const ACTION_KEY := "action"
const OBSERVATION_KEY := "observation"
const WORLD_KEY := "world"
const AGENT_KEY := "agent"
const ENVIRONMENT_KEY := "environment"

const DEFAULT_REPEAT_ACTION := 4
const DEFAULT_TIME_SPEED := 1.0
## What godobuf made of the project's messages. With it answers are protobuf, else JSON.
const MESSAGE_PATH := "res://protobuf_message.gd"

## Acts and observes; to be set in [code]_ready[/code].
var agent: RLAgent
## Everything else; to be set in [code]_ready[/code].
var world: RLEnvWorld
## Script with the class [code]Message[/code]; null for answers in JSON.
# gdlint: disable=class-variable-name
var ProtobufMessage: Script = _load_message()
## Whether a request that asks for no observation is answered, too: by an empty message. The
## original's documentation says no, its Python waits for it. So this is true with a protobuf
## message in the project.
var answers_every_request: bool = ProtobufMessage != null

## The request whose step runs, and its number; null between steps, and where [method _step] is
## overridden.
var _stepping_request = null
var _stepping_number: int = 0
## Frames of steps until it is looked whether the client is still there.
var _frames_to_check: int = Communication.CHECK_EVERY_FRAMES

## Physics frames for which an action is repeated; the client can set it.
onready var repeat_action: int = DEFAULT_REPEAT_ACTION
## How much faster than usual game time passes; the client can set it. A physics step stays as long
## as it is in game time: there are more of them in a second.
onready var time_speed: float = DEFAULT_TIME_SPEED
## Counts the frames of a step.
onready var physics_frames_timer := PhysicsFramesTimer.new(repeat_action)
## Talks with the client.
onready var communication := Communication.new()

onready var _usual_iterations_per_second: int = Engine.iterations_per_second
onready var _timed_repeat_action: int = repeat_action
onready var _is_step_overridden: bool = _count_methods("_step") > 1


## Pauses the game until a client asks for a step.
func _enter_tree() -> void:
	get_tree().paused = true


## Runs before a script's own.
func _ready() -> void:
	pause_mode = Node.PAUSE_MODE_PROCESS
	var error := communication.connect("got_connection", self, "_on_got_connection")
	error += communication.connect("lost_connection", self, "_on_lost_connection")
	assert(error == OK)


func _process(_delta: float) -> void:
	if _stepping_request == null:
		communication.server_poll()
		return
	_frames_to_check -= 1
	if _frames_to_check <= 0:
		_frames_to_check = Communication.CHECK_EVERY_FRAMES
		communication.check_client()


func _physics_process(_delta: float) -> void:
	physics_frames_timer.step()
	if _stepping_request != null and not physics_frames_timer.is_started:
		_end_step()


## Lets the game run for [member repeat_action] physics frames with an action, any JSON value. A
## script may override it and call it by [code]yield(._step(action), "completed")[/code].
func _step(action):
	_begin_step(action)
	yield(physics_frames_timer, "timer_end")
	get_tree().paused = true


## Begins an episode: resets world and agent. To be overridden.
func _reset():
	push_error("%s: override _reset()" % get_path())


## Does what a client asks for, in this order: configure, reset, step, answer.
func _on_got_connection(request: Dictionary):
	var number := communication.request_number
	if (agent == null or world == null) and _needs_what_is_missing(request):
		return
	if request.has(CONFIG_KEY):
		_configure(request[CONFIG_KEY])
	if request.has(RESET_KEY):
		_reset()
	if not request.has(ACTION_KEY):
		_answer(request, number)
	elif _is_step_overridden:
		var running = _step(request[ACTION_KEY])
		if running is GDScriptFunctionState:
			yield(running, "completed")
		_answer(request, number)
	else:  # As _step does, without two coroutines, which take 10 microseconds.
		_stepping_request = request
		_stepping_number = number
		_begin_step(request[ACTION_KEY])


func _begin_step(action) -> void:
	agent.set_action(action)
	if repeat_action != _timed_repeat_action:
		_time_repeat_action()
	get_tree().paused = false
	physics_frames_timer.start()


func _end_step() -> void:
	get_tree().paused = true
	var request: Dictionary = _stepping_request
	_stepping_request = null
	_answer(request, _stepping_number)


## Answers a request, unless its client has gone meanwhile.
func _answer(request: Dictionary, number: int) -> void:
	if number != communication.request_number:
		return
	if request.has(OBSERVATION_KEY):
		_send_response(request[OBSERVATION_KEY])
	elif answers_every_request:
		_send_response({})
	else:
		communication.skip_answer()
		return
	_after_send_response()


## Ends the step that nobody waits for any more.
func _on_lost_connection() -> void:
	physics_frames_timer.finish()
	if _stepping_request != null:
		_end_step()


## Collects what was asked for from world and agent, and sends it.
func _send_response(observation_request: Dictionary):
	if ProtobufMessage != null:
		var message = ProtobufMessage.Message.new()
		if observation_request.has(AGENT_KEY):
			agent.get_data(observation_request[AGENT_KEY], message.new_agent_data())
		if observation_request.has(WORLD_KEY):
			world.get_data(observation_request[WORLD_KEY], message.new_world_data())
		communication.put_bytes(message.to_bytes())
		return
	var answer := {}
	if observation_request.has(AGENT_KEY):
		answer["agent_data"] = {}
		agent.get_data(observation_request[AGENT_KEY], answer["agent_data"])
	if observation_request.has(WORLD_KEY):
		answer["world_data"] = {}
		world.get_data(observation_request[WORLD_KEY], answer["world_data"])
	communication.put_json(answer)


## Called when an answer has been sent. May be overridden.
func _after_send_response():
	pass


## Hands on what the client configures to agent and world, and sets [member repeat_action] and
## [member time_speed].
func _configure(configuration_request: Dictionary):
	if configuration_request.has(AGENT_KEY):
		agent.configure(configuration_request[AGENT_KEY])
	if configuration_request.has(WORLD_KEY):
		world.configure(configuration_request[WORLD_KEY])
	var environment: Dictionary = configuration_request.get(ENVIRONMENT_KEY, {})
	if environment.has("repeat_action"):
		repeat_action = environment["repeat_action"]
		_time_repeat_action()
	if environment.has("time_speed"):
		_set_time_speed(environment["time_speed"])


## Sends a client away that asks for what the script has not set.
func _needs_what_is_missing(request: Dictionary) -> bool:
	var observation: Dictionary = request.get(OBSERVATION_KEY, {})
	var config: Dictionary = request.get(CONFIG_KEY, {})
	for name in [AGENT_KEY, WORLD_KEY]:
		var is_asked := observation.has(name) or config.has(name)
		is_asked = is_asked or (name == AGENT_KEY and request.has(ACTION_KEY))
		if is_asked and get(name) == null:
			communication.send_away("RLEnvironment.%s is not set; set it in _ready()" % name)
			return true
	return false


func _time_repeat_action() -> void:
	_timed_repeat_action = repeat_action
	physics_frames_timer.set_limit(repeat_action)


func _set_time_speed(value: float) -> void:
	time_speed = value
	Engine.time_scale = value
	Engine.iterations_per_second = int(max(1.0, _usual_iterations_per_second * value))


## How many scripts, from the project's own to this one, have a method of this name.
func _count_methods(method: String) -> int:
	var count := 0
	for found in get_script().get_script_method_list():
		count += int(found["name"] == method)
	return count


static func _load_message() -> Script:
	return load(MESSAGE_PATH) as Script if ResourceLoader.exists(MESSAGE_PATH) else null
