extends Node
## Takes the place of [code]sync.gd[/code] of Godot RL Agents: every AIController of the scene
## becomes an agent of Ludus.
##
## Exports, enum and the methods that games override are those of the original. Where a trainer has
## made the scene, it is trained. Elsewhere people play, or in the control mode ONNX_INFERENCE the
## policies that [code]ludus export[/code] has written beside the [code].onnx[/code] files.

## What moves the controllers that leave it to this node.
enum ControlModes {
	HUMAN,  ## A person.
	TRAINING,  ## A trainer; a person where there is none.
	ONNX_INFERENCE,  ## A trained policy.
}

const LudusGdrlAgent := preload("res://addons/ludus_gdrl/gdrl_agent.gd")
const LudusGdrlDemonstrator := preload("res://addons/ludus_gdrl/gdrl_demonstrator.gd")

const CONTROLLER_GROUP := &"AGENT"
## The [code]control_mode[/code] of a controller that leaves it to this node; its next modes are
## those of [enum ControlModes], and then it records demonstrations.
const INHERITED := 0
const RECORD_EXPERT_DEMOS := 4
const TICKS_PER_SECOND := 60
const POLICY_SUFFIX := ".ludus.json"
const HINT := (
	"stock Godot plays no .onnx files: train the game with `ludus train`, "
	+ "then write `ludus export RUN --to %s`"
)

## What moves the controllers that leave it to this node.
@export var control_mode: ControlModes = ControlModes.TRAINING
## Physics ticks per decision.
@export_range(1, 10, 1, "or_greater") var action_repeat: int = 8
## How much faster time passes while no trainer is there; trainers choose that themselves.
@export_range(0, 10, 0.1, "or_greater") var speed_up: float = 1.0
## What plays in the control mode ONNX_INFERENCE: a policy file of Ludus, or the [code].onnx[/code]
## file beside it, whose name but for the ending it has.
@export var onnx_model_path: String = ""
## Whether such a policy takes its most probable actions instead of drawing them.
@export var deterministic_inference: bool = true

## Arguments of the command line, by name without dashes; those without a value have an empty one.
var args: Dictionary = {}
## All controllers, and those that a trainer, a policy or a person moves.
var all_agents: Array = []
var agents_training: Array = []
var agents_inference: Array = []
var agents_heuristic: Array = []
## The former name of [member all_agents].
var agents: Array = []:
	get:
		return all_agents

var _is_trained: bool = false
var _num_ticks: int = 0
var _played: Array[LudusGdrlAgent] = []
## Policies that play, by path.
var _policies: Dictionary[String, LudusPolicy] = {}


## Before any node of the world is ready, as that is where many games draw their first places.
func _enter_tree() -> void:
	var world := LudusWorld.find_above(self)
	if world != null:
		seed(world.index)


func _ready() -> void:
	get_parent().ready.connect(_initialize, CONNECT_ONE_SHOT)


## People play without asking whether an episode has ended.
func _physics_process(_delta: float) -> void:
	if _num_ticks % action_repeat == 0:
		for agent: LudusGdrlAgent in _played:
			if is_instance_valid(agent) and agent.policy == null:
				agent.is_done()
	_num_ticks += 1


## Makes the controllers agents. Games override it, and call it first.
func _initialize() -> void:
	args = _get_args()
	var world := LudusWorld.find_above(self)
	_is_trained = world != null
	if _is_trained:
		world.episode_started.connect(_seed_game.bind(world))
		if world.layout == LudusWorld.Layout.ISOLATED:
			world.settle_ticks = maxi(world.settle_ticks, 1)
	else:
		LudusWorld.of(self)
		action_repeat = int(args.get("action_repeat", action_repeat))
		Engine.physics_ticks_per_second = roundi(_get_speedup() * TICKS_PER_SECOND)
		Engine.time_scale = _get_speedup()
	for controller: Node in get_tree().get_nodes_in_group(CONTROLLER_GROUP):
		if not _is_trained:
			_let_play(controller)
		elif world.root.is_ancestor_of(controller):
			_let_train(controller)


## How much faster time passes than by the clock.
func _get_speedup() -> float:
	return 1.0 if _is_trained else float(args.get("speedup", speed_up))


func _get_args() -> Dictionary:
	var found := {}
	for argument: String in OS.get_cmdline_args() + OS.get_cmdline_user_args():
		found[argument.get_slice("=", 0).lstrip("-")] = (
			argument.get_slice("=", 1) if "=" in argument else ""
		)
	return found


## Games draw from Godot's own random numbers, which all worlds of a process share.
func _seed_game(world: LudusWorld) -> void:
	seed(world.rng.seed)


func _let_train(controller: Node) -> void:
	all_agents.append(controller)
	var own: Variant = controller.get(&"control_mode")
	if own == null or own in [INHERITED, ControlModes.TRAINING + 1, RECORD_EXPERT_DEMOS]:
		agents_training.append(controller)
		var is_played := LudusGdrlDemonstrator.suits(controller)
		var kind: Script = LudusGdrlDemonstrator if is_played else LudusGdrlAgent
		kind.new(controller, action_repeat)
		return
	agents_heuristic.append(controller)
	push_warning(
		"ludus: nothing moves %s in training: its control_mode is its own" % controller.get_path()
	)


func _let_play(controller: Node) -> void:
	all_agents.append(controller)
	var agent := LudusGdrlAgent.new(controller, action_repeat)
	_played.append(agent)
	controller.call(&"set_heuristic", "human")
	var own: Variant = controller.get(&"control_mode")
	var mode: int = control_mode if own == null or own == INHERITED else own - 1
	if mode != ControlModes.ONNX_INFERENCE:
		agents_heuristic.append(controller)
		return
	agents_inference.append(controller)
	agent.sample_actions = not deterministic_inference
	agent.policy = _find_policy(controller)


## The policy in the place of a controller's [code].onnx[/code] file, or null.
func _find_policy(controller: Node) -> LudusPolicy:
	var own: Variant = controller.get(&"onnx_model_path")
	var path: String = onnx_model_path if own == null or own == "" else own
	if not path.ends_with(".json"):
		path = path.get_basename() + POLICY_SUFFIX
	if not _policies.has(path):
		_policies[path] = LudusPolicy.load_file(path)
		if not _policies[path].error.is_empty():
			push_error("ludus: %s: %s; %s" % [get_path(), _policies[path].error, HINT % path])
	return _policies[path] if _policies[path].error.is_empty() else null
