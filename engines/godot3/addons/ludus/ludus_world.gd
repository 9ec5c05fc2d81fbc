tool
class_name LudusWorld, "res://addons/ludus/icons/ludus_world.svg"
extends Node
## What belongs to one world: its random stream, its parameters and how it is copied.
##
## Put it under the root of the scene to choose a layout; a scene without one gets a default world
## while it runs. Get the world of any node with [method of].

## Emitted when all agents of the world begin an episode together, before their
## [code]reset()[/code].
signal episode_started

## How copies of the scene are kept apart. ISOLATED: each copy has its own physics space; any scene
## works. GRID: all copies share one space, far apart; the scene must work in coordinates local to
## its root.
enum Layout { ISOLATED, GRID }

## When an episode ends. AGENT: each agent's episode ends by itself and the agent begins anew at
## once. WORLD: agents that end wait until all agents of the world have ended.
enum Episode { AGENT, WORLD }

const META_NAME := "ludus_world"
## Odd 64-bit constants of splitmix64; they spread neighbouring seeds and episodes far apart.
const _SEED_FACTOR := -7046029254386353131
const _EPISODE_FACTOR := -4658895280553007687
const DISTANCE_3D := Vector3(100.0, 0.0, 100.0)
const NEWCOMERS := "newcomers"
const LEAVERS := "leavers"
## What has happened in any world. Godot 3 has no static variables; what a constant dictionary holds
## is shared all the same.
const _CHANGES := {NEWCOMERS: false, LEAVERS: false}

## How copies are kept apart.
export(Layout) var layout: int = Layout.ISOLATED
## Distance between copies in the grid, in metres or pixels: larger than anything reaches.
## An axis with 0 is not used. All zero: 100 metres on x and z, or in 2D twice the window's size.
export var spacing: Vector3 = Vector3.ZERO
## When an episode ends.
export(Episode) var episode_mode: int = Episode.AGENT
## Ticks that pass between a reset and the first observation. Isolated layout only.
export(int, 0, 10000) var settle_ticks: int = 0
## Slots kept free for agents that join later: policy name to count.
export var spare_slots: Dictionary = {}

## The world's random stream. Use nothing else for randomness in the game.
var rng := RandomNumberGenerator.new()
## Agents that entered the scene and have no slot yet; false for those that found none and wait.
var newcomers: Dictionary = {}
## What the trainer chose for this world, by name; survives from episode to episode.
var parameters: Dictionary = {}
## Index of this world among all worlds of all engines.
var index: int = 0
## Number of episodes begun since the last seeded reset.
var num_episodes: int = 0
## Number of episodes begun since the world was made.
var num_beginnings: int = 0
## Whether people see this copy of the scene: what only draws may be left out where they do not.
var is_drawn: bool = not OS.has_feature("Server")
## Root of this copy of the scene.
var root: Node

var _seed: int = 0


## Godot 3 lets all instances share the default of an exported array or dictionary.
func _init() -> void:
	spare_slots = {}


## Returns the world that [param node] belongs to. A scene that runs on its own becomes a world at
## the first call.
static func of(node: Node) -> LudusWorld:
	var world: LudusWorld = find_above(node)
	return world if world != null else _adopt(node)


## Returns the world that [param node] belongs to, or null.
static func find_above(node: Node) -> LudusWorld:
	var ancestor := node
	while ancestor != null:
		if ancestor.has_meta(META_NAME):
			return ancestor.get_meta(META_NAME)
		ancestor = ancestor.get_parent()
	return null


## Returns the world node in a scene, or null.
static func find_in(scene_root: Node) -> LudusWorld:
	for child in scene_root.get_children():
		if child.get_script() == _own_script():
			return child
	return null


## Notes that some world has newcomers, or that an agent may have left the scene.
static func announce(change: String) -> void:
	_CHANGES[change] = true


## Returns whether that was announced since it was last asked.
static func take_change(change: String) -> bool:
	if not _CHANGES[change]:
		return false
	_CHANGES[change] = false
	return true


## How far apart copies lie in the grid.
func distance_between_copies() -> Vector3:
	if spacing != Vector3.ZERO:
		return spacing
	if not root is Node2D:
		return DISTANCE_3D
	var width: int = ProjectSettings.get_setting("display/window/size/width")
	var height: int = ProjectSettings.get_setting("display/window/size/height")
	return 2.0 * Vector3(width, height, 0.0)


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


## Moves the random stream to the next episode. The stream is a function of the seed and the number
## of the episode only (PROTOCOL.md §5).
func begin_episode() -> void:
	rng.seed = _seed * _SEED_FACTOR + num_episodes * _EPISODE_FACTOR
	num_episodes += 1
	num_beginnings += 1


## A class of Godot 3 cannot name itself.
static func _own_script() -> Script:
	return load("res://addons/ludus/ludus_world.gd") as Script


static func _adopt(node: Node) -> LudusWorld:
	var scene_root := _find_scene_root(node)
	var world: LudusWorld = find_in(scene_root)
	if world == null:
		world = _own_script().new()
		if scene_root == node:
			scene_root.add_child(world)
		else:  # a node below may ask in its own _ready(), when its parents take no children
			scene_root.call_deferred("add_child", world)
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
		if find_in(ancestor) != null:
			return ancestor
		# Nodes that the game makes in code have no owner.
		if ancestor == outermost.owner or ancestor == current:
			outermost = ancestor
		ancestor = ancestor.get_parent()
	return outermost


func _get_configuration_warning() -> String:
	var warnings := PoolStringArray()
	if get_parent() != owner:
		warnings.append("Put LudusWorld directly under the root of the scene.")
	if layout == Layout.GRID and settle_ticks > 0:
		warnings.append(
			"settle_ticks needs the isolated layout: in the grid no world can tick alone."
		)
	if layout == Layout.GRID and not (owner is Node2D or owner is Spatial):
		warnings.append("The grid needs a scene whose root is a Node2D or a Spatial.")
	return warnings.join("\n")
