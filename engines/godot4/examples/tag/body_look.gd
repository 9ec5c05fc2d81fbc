extends Node2D
## Draws chaser or runner with the way it has come.

const Body := preload("res://examples/tag/body.gd")

const INK_COLOR := Color(0.08, 0.1, 0.16)
## Ticks of the trail.
const TRAIL_LENGTH := 40
## A body that moved farther in one tick was put there, pixels.
const JUMP := 40.0
const NUM_SPIKES := 9

@export var color := Color.WHITE
## Draws spikes.
@export var is_hunter: bool = false

var _body: Body
var _heading := Vector2.RIGHT
var _trail := PackedVector2Array()


func _ready() -> void:
	_body = get_parent() as Body


func _physics_process(_delta: float) -> void:
	if _body == null:
		return
	if not _trail.is_empty() and _trail[-1].distance_to(_body.position) > JUMP:
		_trail.clear()
	_trail.append(_body.position)
	if _trail.size() > TRAIL_LENGTH:
		_trail.remove_at(0)
	if _body.velocity.length() > 20.0:
		_heading = _heading.slerp(_body.velocity.normalized(), 0.35).normalized()
	queue_redraw()


func _draw() -> void:
	var radius := _body.radius if _body != null else 16.0
	_draw_trail(radius)
	draw_circle(Vector2(0.0, 4.0), radius, Color(0.0, 0.0, 0.0, 0.4), true, -1.0, true)
	if is_hunter:
		_draw_spikes(radius)
	draw_circle(Vector2.ZERO, radius * (0.86 if is_hunter else 1.0), color, true, -1.0, true)
	for side: float in [-0.42, 0.42]:
		var eye := (_heading * 0.36 + _heading.orthogonal() * side) * radius
		draw_circle(eye, radius * 0.26, Color.WHITE, true, -1.0, true)
		draw_circle(eye + _heading * radius * 0.08, radius * 0.14, INK_COLOR, true, -1.0, true)


## A star that turns with the heading.
func _draw_spikes(radius: float) -> void:
	var points := PackedVector2Array()
	for i: int in 2 * NUM_SPIKES + 1:
		var length := radius * (1.3 if i % 2 == 0 else 0.8)
		points.append(Vector2.from_angle(_heading.angle() + PI * i / NUM_SPIKES) * length)
	draw_polyline(points, color, 2.0, true)
	points.remove_at(2 * NUM_SPIKES)
	draw_colored_polygon(points, color)


func _draw_trail(radius: float) -> void:
	if _trail.size() < 2:
		return
	var colors := PackedColorArray()
	var points := PackedVector2Array()
	for i: int in _trail.size():
		points.append(_trail[i] - _body.position)
		colors.append(Color(color, 0.4 * i / _trail.size()))
	draw_polyline_colors(points, colors, radius * 0.7, true)
