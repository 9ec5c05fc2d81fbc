@tool
@icon("res://addons/ludus/icons/ludus_world.svg")
class_name LudusSimulationHost
extends Node2D
## The root of a scene whose game is a [LudusSimulation].
##
## It makes the simulation, a [LudusWorld] and a [LudusAgent] per agent, and moves the simulation
## on. Nodes below it may draw what [member simulation] does; nothing depends on them. In the grid
## its [member Node2D.position] is the simulation's [member LudusSimulation.offset_2d]; children
## that are [Node3D] are moved by [member LudusSimulation.offset_3d].

## Emitted when an episode has begun and is ready to be observed.
signal episode_begun

const LudusSimulationAgent := preload("res://addons/ludus/simulation/simulation_agent.gd")
const LudusSimulationSeat := preload("res://addons/ludus/simulation/simulation_seat.gd")
const LudusSimulationSpaces := preload("res://addons/ludus/simulation/simulation_spaces.gd")

## The former name of [member sample_actions].
const FORMER_SAMPLE_ACTIONS := &"is_sampling"

## The game: a script that extends [LudusSimulation].
@export var simulation_script: GDScript:
	set(value):
		simulation_script = value
		update_configuration_warnings()
## How copies are kept apart: in physics spaces of their own, or in one, far apart.
@export var layout: LudusWorld.Layout = LudusWorld.Layout.ISOLATED
## Distance between copies in the grid, in pixels or metres: larger than anything reaches. An axis
## with 0 is not used.
@export var spacing: Vector3 = Vector3(2000.0, 2000.0, 0.0)
## When an episode ends: for each agent by itself, or for all agents of the world together.
@export var episode_mode: LudusWorld.Episode = LudusWorld.Episode.WORLD
@export_group("Play")
## The trained policies that play while no trainer is there, by policy name.
@export var policies: Dictionary[String, LudusPolicy] = {}
## Whether they draw their actions instead of taking the most probable ones.
@export var sample_actions: bool = false

## The game; null in the editor.
var simulation: LudusSimulation
## The world.
var world: LudusWorld
## What is wrong with the host, or an empty text.
var error: String = ""
## Whether the simulation ticks only to begin an episode; then it does not move on.
var is_settling: bool = false:
	set(value):
		is_settling = value
		_is_playing = not is_settling and _has_begun and world.is_ready

var _spaces: LudusSimulationSpaces
var _seats: Array[LudusSimulationSeat] = []
var _is_created: bool = false
var _has_begun: bool = false
## Whether the simulation moves on in every tick.
var _is_playing: bool = false
## Whether no tick has passed since the episode began.
var _is_fresh: bool = false
## Whether agents wait for others; only while no trainer is there.
var _has_waiting: bool = false
## What [method LudusSimulation.create] or [method LudusSimulation.begin_episode] has left to do.
var _pending: Object
var _offset_3d: Vector3


func _notification(what: int) -> void:
	if Engine.is_editor_hint():
		set_physics_process(false)
	elif what == NOTIFICATION_SCENE_INSTANTIATED or what == NOTIFICATION_ENTER_TREE:
		_prepare()
	elif what == NOTIFICATION_PREDELETE:
		_clean_up()


## Takes the former name of a property, from scenes that have it.
func _set(property: StringName, value: Variant) -> bool:
	if property != FORMER_SAMPLE_ACTIONS:
		return false
	sample_actions = value
	return true


func _physics_process(_delta: float) -> void:
	if not _is_playing:
		_begin_unasked()
		return
	if simulation.ticked.has_connections():
		simulation.ticked.emit()
	simulation.advance()
	_is_fresh = false
	if _has_waiting:
		_begin_if_all_wait()


## Puts a copy at its place in the grid, before it enters the tree.
func place(offset: Vector3) -> void:
	position += Vector2(offset.x, offset.y)
	_offset_3d = offset
	for child: Node in get_children():
		if child is Node3D:
			(child as Node3D).position += offset


## Lets the simulation tick, or not. [param alone]: only so that an episode can begin.
func set_running(runs: bool, alone: bool) -> void:
	is_settling = runs and alone
	if _spaces != null:
		_spaces.set_active(runs)


## Whether the simulation uses a physics space that other worlds use too.
func is_sharing() -> bool:
	return _spaces != null and _spaces.is_sharing()


## Begins the episode of an agent that has ended, or the world's once all agents have asked. Nothing
## is left to do where [signal LudusWorld.episode_started] came before.
func begin_agent(seat: LudusSimulationSeat) -> void:
	if _is_fresh:
		return
	if not _has_begun:
		_begin()
	elif world.episode_mode == LudusWorld.Episode.AGENT and _seats.size() > 1:
		simulation.begin_agent_episode(seat.index)
	else:
		seat.is_idle = true
		_has_waiting = true
		_begin_if_all_wait()


## The first episode begins by itself where nobody plays.
func _begin_unasked() -> void:
	if not _has_begun and simulation != null:
		world.begin_episode()
		world.episode_started.emit()


func _prepare() -> void:
	if simulation != null or not error.is_empty():
		return
	error = _find_error()
	if not error.is_empty():
		return
	simulation = simulation_script.new()
	world = LudusWorld.find_in(self)
	if world == null:
		world = LudusWorld.new()
		world.name = "LudusWorld"
		world.layout = layout
		world.spacing = spacing
		world.episode_mode = episode_mode
		add_child(world)
	world.attach(self)
	world.set_seed(randi())
	world.episode_started.connect(_begin)
	simulation.world = world
	_add_agents()


func _find_error() -> String:
	if simulation_script == null:
		return "simulation_script of %s is empty" % name
	if not Engine.is_editor_hint() and not simulation_script.can_instantiate():
		return "%s cannot be loaded" % simulation_script.resource_path
	if not _is_simulation(simulation_script):
		return "%s does not extend LudusSimulation" % simulation_script.resource_path
	return ""


static func _is_simulation(script: Script) -> bool:
	while script != null:
		if script.get_global_name() == &"LudusSimulation":
			return true
		script = script.get_base_script()
	return false


func _add_agents() -> void:
	var counts: Dictionary[String, int] = {}
	var names := simulation.policy_names()
	if names.is_empty():
		error = "%s: policy_names() is empty" % simulation.describe()
	for i: int in names.size():
		var number: int = counts.get(names[i], 0)
		counts[names[i]] = number + 1
		var seat := LudusSimulationSeat.new(self, i)
		_seats.append(seat)
		var agent := LudusSimulationAgent.new()
		agent.bind(seat)
		agent.name = names[i].validate_node_name() + str(number)
		agent.policy = policies.get(names[i])
		agent.sample_actions = sample_actions
		add_child(agent)


## Begins an episode; the world is ready when that is over.
func _begin() -> void:
	if not world.is_ready:
		push_error("ludus: %s: an episode begins before the last one has" % simulation.describe())
		return
	_has_begun = true
	_has_waiting = false
	_is_fresh = true
	_set_ready(false)
	if _is_created:
		_begin_episode()
	else:
		_create()
	if not world.is_ready:
		get_tree().physics_frame.connect(_tick)


func _set_ready(is_ready: bool) -> void:
	world.is_ready = is_ready
	_is_playing = is_ready and not is_settling
	for seat: LudusSimulationSeat in _seats:
		seat.is_idle = not is_ready


func _create() -> void:
	_is_created = true
	var is_shared := world.layout == LudusWorld.Layout.GRID
	_spaces = LudusSimulationSpaces.new(self, is_shared)
	simulation._spaces = _spaces
	simulation.offset_2d = global_position if is_shared else Vector2.ZERO
	simulation.offset_3d = _offset_3d if is_shared else Vector3.ZERO
	_run(&"create", _finish_creation.bind(world.rng.state))


## Creation may have drawn what it likes: the episode begins with the random stream it has without.
func _finish_creation(stream: int) -> void:
	world.rng.state = stream
	_begin_episode()


func _begin_episode() -> void:
	_run(&"begin_episode", _finish_beginning)


func _finish_beginning() -> void:
	if get_tree().physics_frame.is_connected(_tick):
		get_tree().physics_frame.disconnect(_tick)
	_set_ready(true)
	episode_begun.emit()


## Calls a method of the simulation that may await ticks, and something else when that is over. An
## [code]await[/code] here would leak if the game ended meanwhile.
func _run(method: StringName, next: Callable) -> void:
	var result: Variant = simulation.call(method)
	if result is not Object:
		next.call()
		return
	_pending = result
	_pending.connect(&"completed", next.unbind(1))


## Tells the simulation that a tick has passed, while it begins. A node would hear of it too late:
## the bridge comes first.
func _tick() -> void:
	if can_process():
		simulation.ticked.emit()


func _begin_if_all_wait() -> void:
	for seat: LudusSimulationSeat in _seats:
		if seat.is_played and not seat.is_idle and not seat.is_done():
			return
	_begin()


func _clean_up() -> void:
	if simulation == null or not _is_created:
		return
	_pending = null
	simulation.clean_up()
	_spaces.clear(simulation.describe(), _region())
	_is_created = false


## The part of a shared space in which this simulation lies.
func _region() -> AABB:
	var size := Vector3.ONE * 2.0 * LudusSimulationSpaces.FAR
	var center := Vector3.ZERO
	if world.layout == LudusWorld.Layout.GRID:
		center = simulation.offset_3d
		if center == Vector3.ZERO:
			center = Vector3(simulation.offset_2d.x, simulation.offset_2d.y, 0.0)
		for axis: int in 3:
			if world.distance_between_copies()[axis] > 0.0:
				size[axis] = world.distance_between_copies()[axis]
	return AABB(center - size / 2.0, size)


func _get_configuration_warnings() -> PackedStringArray:
	var problem := _find_error()
	return [] if problem.is_empty() else PackedStringArray([problem + "."])
