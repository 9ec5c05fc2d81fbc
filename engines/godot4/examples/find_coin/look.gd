extends Node2D
## Draws the room, what both see and both bodies; a touch sends out a ring.

const FindCoin := preload("res://examples/find_coin/find_coin.gd")
const Glide := preload("res://examples/shared/glide.gd")
const Room := preload("res://examples/shared/room_look.gd")
const Walker := preload("res://examples/shared/walker.gd")

const HERO_COLOR := Color(0.36, 0.75, 1.0)
const TARGET_COLOR := Color(1.0, 0.78, 0.3)
const RING_S := 0.7
const RING_RADIUS := 110.0

var _game: FindCoin
var _glides: Array[Glide] = [Glide.new(), Glide.new()]
var _ring_left_s: float = 0.0
var _ring_place := Vector2.ZERO


func _ready() -> void:
	var host := get_parent() as LudusSimulationHost
	if host != null:
		_game = host.simulation as FindCoin
	if _game != null:
		_game.round_ended.connect(_on_round_ended)


func _physics_process(_delta: float) -> void:
	if _game != null:
		_glides[0].step_to(_game.hero.place)
		_glides[1].step_to(_game.target.place)


func _process(delta: float) -> void:
	_ring_left_s = maxf(_ring_left_s - delta, 0.0)
	queue_redraw()


func _draw() -> void:
	if _game == null:
		return
	Room.draw_room(self, _game.map)
	if _game.num_rounds == 0:
		return
	_draw_sight(_game.target, _glides[1].place(), TARGET_COLOR)
	_draw_sight(_game.hero, _glides[0].place(), HERO_COLOR)
	_draw_coin(_glides[1].place())
	Room.draw_body(self, _glides[0].place(), _game.hero.rotation, HERO_COLOR)
	var age := 1.0 - _ring_left_s / RING_S
	if age < 1.0:
		var color := Color(TARGET_COLOR, 1.0 - age)
		draw_arc(_ring_place, RING_RADIUS * sqrt(age), 0.0, TAU, 64, color, 5.0, true)


func _draw_sight(walker: Walker, place: Vector2, color: Color) -> void:
	var from := FindCoin.OTHER_AT
	var hits := walker.observation.slice(from, from + FindCoin.NUM_RAYS)
	Room.draw_rays(self, walker, place, hits, color)


## The target is a coin on legs.
func _draw_coin(place: Vector2) -> void:
	Room.draw_body(self, place, _game.target.rotation, TARGET_COLOR)
	draw_arc(place, Walker.RADIUS * 0.74, 0.0, TAU, 48, TARGET_COLOR.darkened(0.3), 1.5, true)


func _on_round_ended(is_found: bool, _num_steps: int) -> void:
	if is_found:
		_ring_place = (_game.hero.place + _game.target.place) / 2.0
		_ring_left_s = RING_S
