extends Node2D
## Draws a chaser, its ball and a thread between them.

const Chaser := preload("res://examples/ball_chase/chaser.gd")
const RADIUS := 14.0
const BALL_RADIUS := 9.0
const NUM_HUES := 16.0
const HERO_COLOR := Color(1.0, 0.72, 0.33)

var _color := Color.WHITE
var _chaser: Chaser


func _ready() -> void:
	_chaser = get_parent() as Chaser
	if _chaser != null:
		var hue := 0.5 + 0.4 * fmod(_chaser.get_index(), NUM_HUES) / NUM_HUES
		_color = HERO_COLOR if _chaser.is_hero else Color.from_hsv(hue, 0.55, 0.95)


func _process(_delta: float) -> void:
	queue_redraw()


func _draw() -> void:
	if _chaser == null:
		draw_circle(Vector2.ZERO, RADIUS, _color)
		return
	var ball := _chaser.ball - _chaser.position
	draw_line(Vector2.ZERO, ball, Color(_color, 0.16), 2.0, true)
	draw_circle(ball, BALL_RADIUS + 3.0, Color(_color, 0.25), true, -1.0, true)
	draw_circle(ball, BALL_RADIUS, _color.lightened(0.35), true, -1.0, true)
	draw_circle(Vector2.ZERO, RADIUS, _color, true, -1.0, true)
	var eye := _chaser.velocity.limit_length(1.0) * RADIUS * 0.5
	draw_circle(eye, RADIUS * 0.4, Color(0.08, 0.1, 0.16), true, -1.0, true)
	if _chaser.is_hero:
		draw_arc(Vector2.ZERO, RADIUS + 5.0, 0.0, TAU, 32, Color.WHITE, 2.0, true)
