extends Control
## Draws what is known of one agent, see [LudusDebugView].

const LudusWatchedAgent := preload("res://addons/ludus/debug/watched_agent.gd")

const WIDTH := 340.0
const MARGIN := 8.0
const LINE := 15.0
const FONT_SIZE := 12
## Entries with more numbers than this are columns beside each other.
const MAX_ROWS := 8
const COLUMN_HEIGHT := 36.0
const PLOT_HEIGHT := 40.0
const MAX_PICTURE_HEIGHT := 120.0
const BACKGROUND := Color(0.05, 0.07, 0.12, 0.85)
const TEXT := Color(0.9, 0.93, 1.0)
const DIM := Color(0.6, 0.68, 0.82)
const BAR := Color(0.3, 0.65, 1.0)
const TRACK := Color(1.0, 1.0, 1.0, 0.1)
const CHOSEN := Color(0.5, 0.95, 0.6)
const BAND := Color(1.0, 0.75, 0.3, 0.5)
const MEAN := Color(1.0, 0.75, 0.3)

## What is drawn.
var watched: LudusWatchedAgent
## Its headline, and what to press.
var title: String = ""
var help: String = ""

var _font: Font = ThemeDB.fallback_font
var _y: float = 0.0
## The pictures of image entries, so that each is uploaded only once per drawing.
var _textures: Array[ImageTexture] = []


func _init() -> void:
	mouse_filter = Control.MOUSE_FILTER_IGNORE
	texture_filter = CanvasItem.TEXTURE_FILTER_NEAREST


func _draw() -> void:
	# The height is known only after drawing, so the background is that of the frame before.
	draw_rect(Rect2(Vector2.ZERO, size), BACKGROUND)
	_y = MARGIN
	_write(title, TEXT)
	if watched != null and watched.agent() != null:
		_draw_observation()
		_draw_action()
		_draw_plot("reward", watched.rewards, BAR)
		_draw_plot("return", watched.returns, CHOSEN)
		if not is_nan(watched.value):
			_draw_plot("value", watched.values, MEAN)
		else:
			_write("value: not told", DIM)
	_write(help, DIM)
	size = Vector2(WIDTH, _y + MARGIN)


func _draw_observation() -> void:
	var entries := watched.entries
	if watched.seen.size() != entries.size():
		_write("nothing seen yet", DIM)
		return
	_textures.resize(entries.size())
	for i: int in entries.size():
		var entry := entries[i]
		_write(entry.describe(), TEXT)
		if is_picture(entry):
			_draw_picture(i, entry, watched.seen[i])
			continue
		var values := floats_of(entry, watched.seen[i])
		var bounds := bounds_of(entry, values)
		if values.size() <= MAX_ROWS:
			for value: float in values:
				_draw_bar("%.3f" % value, _share(value, bounds), _share(0.0, bounds), BAR)
		else:
			_draw_columns(values, bounds)


func _draw_action() -> void:
	var choice := 0
	var number := 0
	var alternative := 0
	for part: LudusActionComponent in watched.components:
		_write("action %s" % part.name, TEXT)
		if part.kind == LudusActionComponent.Kind.DISCRETE:
			var chosen := watched.choices[choice] if choice < watched.choices.size() else -1
			_draw_choice(part, chosen, alternative)
			choice += 1
			alternative += part.n
			continue
		for k: int in part.size:
			if number < watched.numbers.size():
				_draw_number(part, number)
			number += 1


func _draw_choice(part: LudusActionComponent, chosen: int, first: int) -> void:
	var has_odds := first + part.n <= watched.probabilities.size()
	if part.n > 2 * MAX_ROWS or not has_odds:
		var odds := "  probability %.2f" % watched.probabilities[first + chosen] if has_odds else ""
		_write("   %d of 0 to %d%s" % [chosen, part.n - 1, odds], CHOSEN)
		return
	for k: int in part.n:
		var odds := watched.probabilities[first + k]
		_draw_bar("%d  %.2f" % [k, odds], odds, 0.0, CHOSEN if k == chosen else BAR)


func _draw_number(part: LudusActionComponent, i: int) -> void:
	var bounds := Vector2(part.low, part.high)
	var taken := watched.numbers[i]
	if i >= watched.means.size() or i >= watched.deviations.size():
		_draw_bar("%.3f" % taken, _share(taken, bounds), _share(0.0, bounds), CHOSEN)
		return
	var mean := watched.means[i]
	var deviation := watched.deviations[i]
	var track := _draw_bar("%.3f" % taken, 0.0, 0.0, CHOSEN)
	var low := _share(mean - deviation, bounds)
	var high := _share(mean + deviation, bounds)
	var left := track.position.x
	var width := track.size.x
	var band := Rect2(left + low * width, track.position.y, (high - low) * width, track.size.y)
	draw_rect(band, BAND)
	_draw_mark(track, _share(mean, bounds), MEAN)
	_draw_mark(track, _share(taken, bounds), CHOSEN)
	_write("   mean %.3f, deviation %.3f" % [mean, deviation], DIM)


func _draw_mark(track: Rect2, share: float, colour: Color) -> void:
	draw_rect(
		Rect2(track.position.x + share * track.size.x - 1.0, track.position.y, 2.0, 11.0), colour
	)


## Draws a bar between two shares of its track, and returns the track.
func _draw_bar(text: String, share: float, from: float, colour: Color) -> Rect2:
	var track := Rect2(110.0, _y + 2.0, WIDTH - 110.0 - MARGIN, 11.0)
	draw_rect(track, TRACK)
	var left := minf(share, from) * track.size.x
	var width := maxf(absf(share - from) * track.size.x, 1.0)
	draw_rect(Rect2(track.position.x + left, track.position.y, width, 11.0), colour)
	_write("   " + text, DIM)
	return track


func _draw_columns(values: PackedFloat32Array, bounds: Vector2) -> void:
	var area := Rect2(MARGIN, _y + 2.0, WIDTH - 2.0 * MARGIN, COLUMN_HEIGHT)
	draw_rect(area, TRACK)
	var width := area.size.x / values.size()
	var zero := _share(0.0, bounds)
	for i: int in values.size():
		var share := _share(values[i], bounds)
		var top := area.end.y - maxf(share, zero) * area.size.y
		var height := maxf(absf(share - zero) * area.size.y, 1.0)
		draw_rect(Rect2(area.position.x + i * width, top, maxf(width - 1.0, 1.0), height), BAR)
	_y += COLUMN_HEIGHT + 6.0


func _draw_picture(i: int, entry: LudusObservationEntry, bytes: PackedByteArray) -> void:
	var rows := entry.shape[-3]
	var columns := entry.shape[-2]
	var format := Image.FORMAT_RGB8 if entry.shape[-1] == 3 else Image.FORMAT_L8
	# Of a stack of pictures the last one, which is the newest.
	var newest := bytes.slice(bytes.size() - rows * columns * entry.shape[-1])
	var picture := Image.create_from_data(columns, rows, false, format, newest)
	if _textures[i] == null or Vector2i(_textures[i].get_size()) != picture.get_size():
		_textures[i] = ImageTexture.create_from_image(picture)
	else:
		_textures[i].update(picture)
	var limits := Vector2(WIDTH - 2.0 * MARGIN, MAX_PICTURE_HEIGHT)
	var zoom := minf(limits.x / columns, limits.y / rows)
	draw_texture_rect(_textures[i], Rect2(MARGIN, _y + 2.0, columns * zoom, rows * zoom), false)
	_y += rows * zoom + 6.0


func _draw_plot(what: String, line: PackedFloat32Array, colour: Color) -> void:
	if line.is_empty():
		return
	var bounds := _range_of(line)
	_write("%s %.3f   (%.3f to %.3f)" % [what, line[-1], bounds.x, bounds.y], TEXT)
	var area := Rect2(MARGIN, _y, WIDTH - 2.0 * MARGIN, PLOT_HEIGHT)
	draw_rect(area, TRACK)
	var points := PackedVector2Array()
	for i: int in line.size():
		if is_nan(line[i]):
			continue
		var x := area.position.x + area.size.x * i / (LudusWatchedAgent.MAX_HISTORY - 1)
		points.append(Vector2(x, area.end.y - _share(line[i], bounds) * area.size.y))
	if points.size() > 1:
		draw_polyline(points, colour, 1.0)
	_y += PLOT_HEIGHT + 4.0


func _write(text: String, colour: Color) -> void:
	var place := Vector2(MARGIN, _y + LINE - 4.0)
	var room := WIDTH - 2.0 * MARGIN
	draw_string(_font, place, text, HORIZONTAL_ALIGNMENT_LEFT, room, FONT_SIZE, colour)
	_y += LINE


## Whether an entry is a picture that can be drawn.
static func is_picture(entry: LudusObservationEntry) -> bool:
	return (
		entry.dtype == LudusObservationEntry.DType.UINT8
		and entry.shape.size() >= 3
		and entry.shape[-1] in [1, 3]
	)


## The numbers of an entry from its bytes.
static func floats_of(entry: LudusObservationEntry, bytes: PackedByteArray) -> PackedFloat32Array:
	match entry.dtype:
		LudusObservationEntry.DType.UINT8:
			return PackedFloat32Array(Array(bytes))
		LudusObservationEntry.DType.INT64:
			return PackedFloat32Array(Array(bytes.to_int64_array()))
	return bytes.to_float32_array()


## Between what bars are drawn: the bounds that are declared; where there are none, the range of
## what is seen, with 0 in it.
static func bounds_of(entry: LudusObservationEntry, values: PackedFloat32Array) -> Vector2:
	var seen := _range_of(values)
	return Vector2(
		entry.low if is_finite(entry.low) else minf(seen.x, 0.0),
		entry.high if is_finite(entry.high) else maxf(seen.y, 0.0)
	)


static func _range_of(values: PackedFloat32Array) -> Vector2:
	var low := INF
	var high := -INF
	for number: float in values:
		if is_finite(number):
			low = minf(low, number)
			high = maxf(high, number)
	return Vector2(low, high) if low <= high else Vector2.ZERO


static func _share(number: float, bounds: Vector2) -> float:
	if bounds.y <= bounds.x or is_nan(number):
		return 0.5
	return clampf((number - bounds.x) / (bounds.y - bounds.x), 0.0, 1.0)
