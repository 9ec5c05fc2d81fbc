@tool
@icon("res://addons/ludus/icons/ludus_world.svg")
class_name LudusWorld
extends Node
## What belongs to one world: its random stream, its parameters and how it is copied.
##
## Put it under the root of the scene to choose a layout; a scene without one gets a default world
## while it runs. Get the world of any node with [method of].

## Emitted when all agents of the world begin an episode together, before their
## [code]reset()[/code].
signal episode_started

## How copies of the scene are kept apart.
enum Layout {
	## Each copy has its own physics space. Any scene works.
	ISOLATED,
	## All copies share one space, far apart: much faster for light games. The scene must work in
	## coordinates local to its root.
	GRID,
}

## When an episode ends.
enum Episode {
	AGENT,  ## Each agent's episode ends by itself and the agent begins anew at once.
	WORLD,  ## Agents that end wait until all agents of the world have ended.
}

const LudusRegistry := preload("res://addons/ludus/bridge/registry.gd")

const META_NAME := &"ludus_world"
## Method of the root of a viewer scene: one that shows the worlds instead of being one. It returns
## the [PackedScene] that worlds are copies of.
const VIEWER_METHOD := &"ludus_world_scene"
const DISTANCE_3D := Vector3(100.0, 0.0, 100.0)
## Odd 64-bit constants of splitmix64; they spread neighbouring seeds and episodes far apart.
const _SEED_FACTOR := -7046029254386353131
const _EPISODE_FACTOR := -4658895280553007687

## How copies are kept apart.
@export var layout: LudusWorld.Layout = Layout.ISOLATED:
	set(value):
		layout = value
		update_configuration_warnings()
## Distance between copies in the grid, in metres or pixels: larger than anything reaches.
## An axis with 0 is not used. All zero: 100 metres on x and z, or in 2D twice the window's size.
@export var spacing: Vector3 = Vector3.ZERO
## When an episode ends.
@export var episode_mode: LudusWorld.Episode = Episode.AGENT
## Ticks that pass between a reset and the first observation. Isolated layout only.
@export_range(0, 10000) var settle_ticks: int = 0:
	set(value):
		settle_ticks = value
		update_configuration_warnings()
## Slots kept free for agents that join later: policy name to count.
@export var spare_slots: Dictionary[String, int] = {}

## Methods of the scene's root and of agents' nodes that Python may call, beside those whose names
## begin with [code]ludus_[/code].
@export var callable_methods: PackedStringArray = []

## The world's random stream. Use nothing else for randomness in the game.
var rng := RandomNumberGenerator.new()
## What the trainer chose for this world, by name; survives from episode to episode.
var parameters: Dictionary = {}
## Index of this world among all worlds of all engines.
var index: int = 0
## Number of episodes begun since the last seeded reset.
var num_episodes: int = 0
## Number of episodes begun since the world was made.
var num_beginnings: int = 0
## The beginning after which bodies were last put where their nodes are, for sensors.
var num_placed: int = 0
## Whether the episode that has begun can be observed; false while a [LudusSimulation] awaits ticks
## to begin it.
var is_ready: bool = true
## Whether people see this copy of the scene: what only draws may be left out where they do not.
var is_drawn: bool = DisplayServer.get_name() != "headless"
## How far this copy was moved from where the scene puts it, in a 2D grid.
var grid_offset := Vector2.ZERO
## Root of this copy of the scene.
var root: Node

var _seed: int = 0


## Returns the world that [param node] belongs to. A scene that runs on its own becomes a world at
## the first call.
static func of(node: Node) -> LudusWorld:
	var world := find_above(node)
	return world if world != null else _adopt(node)


## Returns the world that [param node] belongs to, or null.
static func find_above(node: Node) -> LudusWorld:
	var ancestor := node
	while ancestor != null:
		if ancestor.has_meta(META_NAME):
			return ancestor.get_meta(META_NAME)
		ancestor = ancestor.get_parent()
	return null


static func _adopt(node: Node) -> LudusWorld:
	var scene_root := _find_scene_root(node)
	var world := find_in(scene_root)
	if world == null:
		world = LudusWorld.new()
		var add := scene_root.add_child.bind(world, false, Node.INTERNAL_MODE_BACK)
		if scene_root.is_node_ready():
			add.call()
		else:  # a node below asks in its own _ready(), when its parents take no children
			add.call_deferred()
	world.attach(scene_root)
	world.set_seed(randi())
	world.begin_episode()
	return world


## Returns the root of what a trainer would copy: of all scenes around [param node], the innermost
## one that has a world node, or else the outermost one.
static func _find_scene_root(node: Node) -> Node:
	var current := node.get_tree().current_scene if node.is_inside_tree() else null
	var outermost := node
	var ancestor := node
	while ancestor != null:
		if not ancestor.has_method(VIEWER_METHOD):
			if find_in(ancestor) != null:
				return ancestor
			# Nodes that the game makes in code have no owner.
			if ancestor == outermost.owner or ancestor == current:
				outermost = ancestor
		ancestor = ancestor.get_parent()
	return outermost


## Returns the world node in a scene, or null.
static func find_in(scene_root: Node) -> LudusWorld:
	for child: Node in scene_root.get_children(true):
		if child is LudusWorld:
			return child
	return null


## Adds a value to a metric of the training run: its mean, lowest and highest value and count since
## the last update go to all places where metrics go, such as [code]metrics.jsonl[/code] and
## TensorBoard. Does nothing where nobody trains the game. There may be 64 metrics, with names of 1
## to 128 printable characters, without a space at either end. NaN, infinity, another name or a 65th
## metric ends the training with an error that names the node.
func report_metric(metric: String, value: float) -> void:
	if LudusRegistry.bridge != null:
		LudusRegistry.bridge.report_metric(metric, value, root)


## Makes this the world of everything under [param scene_root].
func attach(scene_root: Node) -> void:
	root = scene_root
	root.set_meta(META_NAME, self)


## Goes on where the world that this one replaces stood.
func take_over(old: LudusWorld) -> void:
	parameters = old.parameters
	num_episodes = old.num_episodes
	_seed = old._seed


## Starts the random stream anew: the next episode is the first one of [param value].
func set_seed(value: int) -> void:
	_seed = value
	num_episodes = 0


## How far apart copies lie in the grid.
func distance_between_copies() -> Vector3:
	if not spacing.is_zero_approx():
		return spacing
	if root is not Node2D:
		return DISTANCE_3D
	var width: int = ProjectSettings.get_setting("display/window/size/viewport_width")
	var height: int = ProjectSettings.get_setting("display/window/size/viewport_height")
	return 2.0 * Vector3(width, height, 0.0)


## Moves the random stream to the next episode. The stream is a function of the seed and the number
## of the episode only (PROTOCOL.md §5).
func begin_episode() -> void:
	rng.seed = _seed * _SEED_FACTOR + num_episodes * _EPISODE_FACTOR
	num_episodes += 1
	num_beginnings += 1


func _get_configuration_warnings() -> PackedStringArray:
	var warnings := PackedStringArray()
	if get_parent() != owner:
		warnings.append("Put LudusWorld directly under the root of the scene.")
	if layout == Layout.GRID and settle_ticks > 0:
		warnings.append(
			"settle_ticks needs the isolated layout: in the grid no world can tick alone."
		)
	if layout == Layout.GRID and not (owner is Node2D or owner is Node3D):
		warnings.append("The grid needs a scene whose root is a Node2D or a Node3D.")
	return warnings
