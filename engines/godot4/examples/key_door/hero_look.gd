extends Node2D
## Draws the hero and the key, which it carries before it once it has it.

const KeyDoor := preload("res://examples/key_door/key_door.gd")
const Palette := preload("res://examples/key_door/palette.gd")
const Plan := preload("res://examples/key_door/plan.gd")

const HERO_COLOR := Color(0.93, 0.95, 1.0)
const RADIUS := 30.0
## Rate at which the picture catches up with the game, per second.
const GLIDE := 18.0
## A hero that is farther away than this was put there, pixels.
const JUMP := 1.5 * Palette.CELL

var _game: KeyDoor
var _place := Vector2.ZERO
var _heading := Vector2.RIGHT
var _age_s: float = 0.0


func _ready() -> void:
	_game = get_parent() as KeyDoor


func _process(delta: float) -> void:
	if _game == null:
		return
	_age_s += delta
	var goal := Palette.centre(_game.hero)
	if goal.distance_to(_place) > JUMP:
		_place = goal
	if goal.distance_to(_place) > 4.0:
		_heading = _heading.slerp(_place.direction_to(goal), 1.0 - exp(-GLIDE * delta)).normalized()
	_place = _place.lerp(goal, 1.0 - exp(-GLIDE * delta))
	queue_redraw()


func _draw() -> void:
	if _game == null:
		_draw_hero(Vector2.ZERO)
		return
	var color := Palette.HIDDEN_COLOR
	if _game.is_coloured():
		color = Palette.DOOR_COLORS[_game.door]
	if not _game.has_key:
		var lift := Vector2(0.0, 3.0 * sin(3.0 * _age_s))
		_draw_key(Palette.centre(_game.key) + lift, 1.0, color)
	_draw_hero(_place)
	if _game.has_key:
		_draw_key(_place + Vector2(0.0, -RADIUS - 14.0), 0.8, color)


func _draw_hero(place: Vector2) -> void:
	draw_circle(place + Vector2(0.0, 5.0), RADIUS, Color(0.0, 0.0, 0.0, 0.35), true, -1.0, true)
	draw_circle(place, RADIUS, HERO_COLOR, true, -1.0, true)
	var across := _heading.orthogonal() * RADIUS * 0.36
	for eye: Vector2 in [across, -across]:
		draw_circle(
			place + _heading * RADIUS * 0.42 + eye,
			RADIUS * 0.17,
			Palette.INK_COLOR,
			true,
			-1.0,
			true
		)


## A bow with the sign of its door, a shaft and two teeth; about 60 pixels wide at size 1.
func _draw_key(place: Vector2, size: float, color: Color) -> void:
	var bow := place + Vector2(-16.0, 0.0) * size
	draw_circle(bow, 26.0 * size, Color(color, 0.18), true, -1.0, true)
	draw_line(bow, bow + Vector2(48.0, 0.0) * size, color, 7.0 * size, true)
	for x: float in [34.0, 45.0]:
		var tooth := bow + Vector2(x, 0.0) * size
		draw_line(tooth, tooth + Vector2(0.0, 13.0) * size, color, 6.0 * size, true)
	draw_circle(bow, 16.0 * size, color, true, -1.0, true)
	if _game.is_coloured():
		Palette.draw_sign(self, bow, _game.door, 8.0 * size, Palette.INK_COLOR)
	else:
		draw_circle(bow, 7.0 * size, Palette.INK_COLOR, true, -1.0, true)
