extends Node2D
## Fetches a key and opens the door of its colour, which shows at the beginning only.
##
## A game without physics, cell by cell: a step is one move. It needs memory (the colour is gone
## before the doors come into reach) and an action mask (no moves into walls, no door without key).

## Emitted when a door is opened.
signal door_opened(is_right: bool, door: int)

## What the agent can do; the moves are those of the floor plan.
enum Action { LEFT, RIGHT, UP, DOWN, OPEN }

const InWindow := preload("res://examples/shared/in_window.gd")
const Plan := preload("res://examples/key_door/plan.gd")

## No key was pressed since the last step.
const NOTHING := -1
## What the keyboard does by hand.
const KEYBOARD: Dictionary[Key, Action] = {
	KEY_LEFT: Action.LEFT,
	KEY_RIGHT: Action.RIGHT,
	KEY_UP: Action.UP,
	KEY_DOWN: Action.DOWN,
	KEY_A: Action.LEFT,
	KEY_D: Action.RIGHT,
	KEY_W: Action.UP,
	KEY_S: Action.DOWN,
	KEY_SPACE: Action.OPEN,
}
## The key shows its colour in this many observations.
const NUM_COLOURED := 3
## For the key, unless the world's parameter [code]key_reward[/code] says how much.
const KEY_REWARD := 0.1
const DOOR_REWARD := 0.9

## Where the hero stands.
var hero := Vector2i.ZERO
## Where the key lies, or lay.
var key := Vector2i.ZERO
var has_key: bool = false
## The door that fits the key.
var door: int = 0
## Moves made in this episode.
var num_moves: int = 0

var _world: LudusWorld
var _reward: float = 0.0
var _is_over: bool = false
var _pressed: int = NOTHING


func _ready() -> void:
	_world = LudusWorld.of(self)
	InWindow.show(self)


## Keeps what a person pressed for the next step; a key that is held repeats itself.
func _unhandled_key_input(event: InputEvent) -> void:
	if event.is_pressed():
		_pressed = KEYBOARD.get((event as InputEventKey).physical_keycode, _pressed)


## Moves, or opens the door. What the mask forbids does nothing, but counts as a move.
func apply_action(action: int) -> void:
	_reward = 0.0
	num_moves += 1
	if action == Action.OPEN:
		_open(Plan.door_at(hero))
	elif Plan.moves_from(hero)[action] == 1:
		_enter(hero + Plan.MOVES[action])


## Returns which of the five actions make sense here, 1 = allowed.
func get_action_mask() -> PackedByteArray:
	var mask := Plan.moves_from(hero).duplicate()
	mask.append(int(has_key and Plan.door_at(hero) >= 0))
	return mask


## Returns the hero's place, whether it has the key, the way to a key that lies, and the key's
## colour as one-hot numbers as long as it shows.
func get_observation() -> PackedFloat32Array:
	var way := Vector2i.ZERO if has_key else key - hero
	var seen := PackedFloat32Array(
		[
			float(hero.x) / Plan.LAST_COLUMN,
			hero.y - 1.0,
			float(has_key),
			float(way.x) / Plan.LAST_COLUMN,
			way.y / 2.0,
		]
	)
	for i: int in Plan.NUM_DOORS:
		seen.append(float(i == door and is_coloured()))
	return seen


## Returns 0.1 for picking up the key, 0.9 for opening the right door.
func get_reward() -> float:
	return _reward


## Returns whether a door was opened.
func is_done() -> bool:
	return _is_over


## Puts hero and key into the room, and chooses the door unless the world's parameter
## [code]door[/code] says which.
func reset() -> void:
	var num_cells := Plan.ROOM_SIZE.x * Plan.ROOM_SIZE.y
	var hero_cell := _world.rng.randi_range(0, num_cells - 1)
	var key_cell := (hero_cell + _world.rng.randi_range(1, num_cells - 1)) % num_cells
	hero = Plan.room_cell(hero_cell)
	key = Plan.room_cell(key_cell)
	var drawn := _world.rng.randi_range(0, Plan.NUM_DOORS - 1)
	door = int(_world.parameters.get("door", drawn))
	has_key = false
	num_moves = 0
	_reward = 0.0
	_is_over = false


## Lets a person play with the arrow keys or W, A, S and D, and Space for the door. Time stands
## still (null) until a key is pressed that does something.
func get_manual_action() -> Variant:
	var action := _pressed
	_pressed = NOTHING
	if action == NOTHING or get_action_mask()[action] == 0:
		_reward = 0.0
		return null
	return action


## Whether the key shows its colour.
func is_coloured() -> bool:
	return num_moves < NUM_COLOURED


func _enter(cell: Vector2i) -> void:
	hero = cell
	if cell == key and not has_key:
		has_key = true
		_reward = float(_world.parameters.get("key_reward", KEY_REWARD))


func _open(chosen: int) -> void:
	if chosen < 0 or not has_key:
		return
	_is_over = true
	if chosen == door:
		_reward = DOOR_REWARD
	door_opened.emit(chosen == door, chosen)
