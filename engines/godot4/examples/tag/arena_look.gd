extends Node2D
## Draws floor, walls, pillars and what is left of the time; the end of a round sends out a ring.

const Arena := preload("res://examples/tag/arena.gd")
const Round := preload("res://examples/tag/round.gd")

const FLOOR_COLOR := Color(0.085, 0.1, 0.16)
const LINE_COLOR := Color(0.11, 0.135, 0.215)
const WALL_COLOR := Color(0.3, 0.38, 0.6)
const EDGE_COLOR := Color(0.5, 0.62, 0.95)
const PILLAR_TOP_COLOR := Color(0.37, 0.46, 0.72)
const TIME_COLOR := Color(1.0, 0.78, 0.45)
const CAUGHT_COLOR := Color(0.93, 0.32, 0.36)
const ESCAPED_COLOR := Color(0.36, 0.75, 1.0)
const LINE_PITCH := 40.0
const WALL := 20.0
## How long a ring grows, seconds, and how large, pixels.
const RING_S := 0.9
const RING_RADIUS := 190.0

var _arena: Arena
var _ring_place := Vector2.ZERO
var _ring_color := CAUGHT_COLOR
var _ring_left_s: float = 0.0


func _ready() -> void:
	_arena = get_parent() as Arena
	if _arena != null:
		_arena.round_ended.connect(_on_round_ended)


func _process(delta: float) -> void:
	_ring_left_s = maxf(_ring_left_s - delta, 0.0)
	queue_redraw()


func _draw() -> void:
	var half := Round.HALF_SIDE
	var inside := Rect2(-half, -half, 2.0 * half, 2.0 * half)
	draw_rect(inside.grow(WALL), WALL_COLOR)
	draw_rect(inside, FLOOR_COLOR)
	for i: int in range(1, int(2.0 * half / LINE_PITCH)):
		var at := -half + i * LINE_PITCH
		draw_line(Vector2(at, -half), Vector2(at, half), LINE_COLOR, 2.0)
		draw_line(Vector2(-half, at), Vector2(half, at), LINE_COLOR, 2.0)
	draw_rect(inside, EDGE_COLOR, false, 2.0)
	if _arena == null:
		return
	_draw_pillars()
	_draw_time(_arena.game.time_left())
	_draw_ring(1.0 - _ring_left_s / RING_S)


func _draw_pillars() -> void:
	for i: int in _arena.game.pillars.size():
		var centre := _arena.game.pillars[i]
		var radius := _arena.game.radii[i]
		draw_circle(centre + Vector2(0.0, 6.0), radius, Color(0.0, 0.0, 0.0, 0.4), true, -1.0, true)
		draw_circle(centre, radius, WALL_COLOR, true, -1.0, true)
		draw_circle(centre, radius * 0.72, PILLAR_TOP_COLOR, true, -1.0, true)
		draw_arc(centre, radius, 0.0, TAU, 48, EDGE_COLOR, 2.0, true)


## A line in the upper wall that shrinks.
func _draw_time(share: float) -> void:
	var y := -Round.HALF_SIDE - WALL / 2.0
	var half := Round.HALF_SIDE * share
	draw_line(Vector2(-Round.HALF_SIDE, y), Vector2(Round.HALF_SIDE, y), FLOOR_COLOR, 6.0)
	draw_line(Vector2(-half, y), Vector2(half, y), TIME_COLOR, 6.0)


func _draw_ring(age: float) -> void:
	if age < 1.0:
		var color := Color(_ring_color, 0.9 * (1.0 - age))
		draw_arc(_ring_place, RING_RADIUS * sqrt(age), 0.0, TAU, 64, color, 6.0, true)


func _on_round_ended(is_caught: bool) -> void:
	_ring_place = (_arena.get_node("Runner") as Node2D).position
	_ring_color = CAUGHT_COLOR if is_caught else ESCAPED_COLOR
	_ring_left_s = RING_S
