@tool
extends Control
## Follows [code]metrics.jsonl[/code] of a run, and draws the mean return of each policy.

const MARGIN := 6.0
const FONT_SIZE := 12
const COLOURS: Array[Color] = [
	Color(0.4, 0.75, 1.0), Color(0.55, 0.9, 0.55), Color(1.0, 0.7, 0.4), Color(0.9, 0.6, 0.95)
]
const POLL_MS := 500
const MAX_POINTS := 2000

## Agent steps so far, and how many there are per second.
var agent_steps: float = 0.0
var steps_per_s: float = 0.0

var _path: String = ""
var _position: int = 0
var _polled_ms: int = 0
## Points of each policy: agent steps, and mean return.
var _lines: Dictionary[String, PackedVector2Array] = {}


func _init() -> void:
	custom_minimum_size = Vector2(220.0, 120.0)
	tooltip_text = "Mean return of each policy over agent steps."


## Follows the run in a folder from its beginning; an empty path shows nothing.
func follow(run: String) -> void:
	_path = run.path_join("metrics.jsonl") if not run.is_empty() else ""
	_position = 0
	_polled_ms = 0
	_lines.clear()
	agent_steps = 0.0
	steps_per_s = 0.0
	queue_redraw()


## Reads the lines that are new. Call it in every frame; it looks twice a second.
func poll() -> void:
	var now := Time.get_ticks_msec()
	if _path.is_empty() or now - _polled_ms < POLL_MS:
		return
	_polled_ms = now
	var file := FileAccess.open(_path, FileAccess.READ)
	if file == null or file.get_length() <= _position:
		return
	file.seek(_position)
	var bytes := file.get_buffer(file.get_length() - _position)
	var end := bytes.rfind(10) + 1
	_position += end
	for line: String in bytes.slice(0, end).get_string_from_utf8().split("\n", false):
		_take(line)
	queue_redraw()


## The name of the run that is followed.
func run_name() -> String:
	return _path.get_base_dir().get_file()


## The last mean return of each policy, by name.
func last_returns() -> Dictionary[String, float]:
	var returns: Dictionary[String, float] = {}
	for policy: String in _lines:
		if not _lines[policy].is_empty():
			returns[policy] = _lines[policy][-1].y
	return returns


func _take(line: String) -> void:
	var json := JSON.new()
	if json.parse(line) != OK or json.data is not Dictionary:
		return
	var metrics: Dictionary = json.data
	agent_steps = _number(metrics.get("agent_steps"))
	steps_per_s = _number(metrics.get("steps_per_s"))
	var policies: Variant = metrics.get("policies")
	if policies is not Dictionary:
		return
	for policy: String in policies:
		var mean: Variant = (policies[policy] as Dictionary).get("mean_return")
		if mean is not float and mean is not int:
			continue
		var points: PackedVector2Array = _lines.get(policy, PackedVector2Array())
		points.append(Vector2(agent_steps, float(mean)))
		_lines[policy] = _thinned(points)


## Every second point, once there are too many.
static func _thinned(points: PackedVector2Array) -> PackedVector2Array:
	if points.size() <= MAX_POINTS:
		return points
	var thinned := PackedVector2Array()
	for i: int in range(0, points.size(), 2):
		thinned.append(points[i])
	return thinned


static func _number(value: Variant) -> float:
	return float(value) if value is float or value is int else 0.0


func _draw() -> void:
	var area := Rect2(Vector2.ZERO, size).grow(-MARGIN)
	draw_rect(Rect2(Vector2.ZERO, size), Color(0.0, 0.0, 0.0, 0.2))
	var font := get_theme_default_font()
	if _lines.is_empty():
		var text := "The curve of a run appears here."
		draw_string(font, area.get_center() - Vector2(95.0, 0.0), text, 0, -1, FONT_SIZE)
		return
	var bounds := _bounds()
	var i := 0
	for policy: String in _lines:
		var colour := COLOURS[i % COLOURS.size()]
		var points := PackedVector2Array()
		for point: Vector2 in _lines[policy]:
			var share := (point - bounds.position) / bounds.size
			points.append(area.position + Vector2(share.x, 1.0 - share.y) * area.size)
		if points.size() > 1:
			draw_polyline(points, colour, 1.5, true)
		var text := "%s: %s" % [policy, String.num(_lines[policy][-1].y, 3)]
		var place := area.position + Vector2(0.0, 14.0 * (i + 1))
		draw_string(font, place, text, HORIZONTAL_ALIGNMENT_LEFT, -1, FONT_SIZE, colour)
		i += 1
	var scale_text := "%s to %s" % [String.num(bounds.position.y, 3), String.num(bounds.end.y, 3)]
	draw_string(font, Vector2(area.position.x, area.end.y), scale_text, 0, -1, FONT_SIZE)


func _bounds() -> Rect2:
	var low := Vector2(INF, INF)
	var high := -low
	for policy: String in _lines:
		for point: Vector2 in _lines[policy]:
			low = low.min(point)
			high = high.max(point)
	return Rect2(low, (high - low).max(Vector2(1.0, 1e-6)))
