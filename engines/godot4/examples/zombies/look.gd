extends Node2D
## Draws the room, what all see, bodies with their health, shots, bites and reloading.

const Fighter := preload("res://examples/zombies/fighter.gd")
const Glide := preload("res://examples/shared/glide.gd")
const Room := preload("res://examples/shared/room_look.gd")
const Soldier := preload("res://examples/zombies/soldier.gd")
const Zombie := preload("res://examples/zombies/zombie.gd")
const Zombies := preload("res://examples/zombies/zombies.gd")

const SOLDIER_COLOR := Color(0.36, 0.75, 1.0)
const ZOMBIE_COLOR := Color(0.42, 0.78, 0.4)
const DEAD_COLOR := Color(0.25, 0.3, 0.34)
const SHOT_COLOR := Color(1.0, 0.86, 0.45)
const PAIN_COLOR := Color(1.0, 0.3, 0.3)
const BAR_SIZE := Vector2(44.0, 5.0)
const BAR_LIFT := 34.0
## Seconds that a shot, a bite and a wound stay visible.
const FLASH_S := 0.18

var _game: Zombies
var _fighters: Array[Fighter] = []
var _glides: Array[Glide] = []
var _last_step: int = -1
var _last_round: int = 0
var _shot_left_s: float = 0.0
var _pain_left_s := PackedFloat64Array([0.0, 0.0, 0.0])
var _bite_left_s := PackedFloat64Array([0.0, 0.0])


func _ready() -> void:
	var host := get_parent() as LudusSimulationHost
	if host == null or host.simulation is not Zombies:
		return
	_game = host.simulation
	_fighters.append(_game.soldier)
	_fighters.append_array(_game.zombies)
	for fighter: Fighter in _fighters:
		_glides.append(Glide.new())


func _physics_process(_delta: float) -> void:
	if _game == null:
		return
	for i: int in _fighters.size():
		_glides[i].step_to(_fighters[i].place)
	if _game.num_rounds != _last_round:
		_last_round = _game.num_rounds
		_shot_left_s = 0.0
		_pain_left_s.fill(0.0)
		_bite_left_s.fill(0.0)
	if _game.num_steps != _last_step:
		_last_step = _game.num_steps
		_note_events()


func _process(delta: float) -> void:
	_shot_left_s -= delta
	for i: int in _fighters.size():
		_pain_left_s[i] -= delta
	for i: int in 2:
		_bite_left_s[i] -= delta
	if _game != null:
		_game.manual_aim = (get_local_mouse_position() - _game.soldier.place).angle()
	queue_redraw()


func _draw() -> void:
	if _game == null:
		return
	Room.draw_room(self, _game.map)
	if _game.num_rounds == 0:
		return
	for i: int in _fighters.size():
		_draw_sight(i)
	for i: int in range(_fighters.size() - 1, -1, -1):
		_draw_fighter(i)
	_draw_shot()
	for i: int in _fighters.size():
		_draw_health(_fighters[i], _glides[i].place())
	_draw_rifle(_glides[0].place())


func _note_events() -> void:
	if _game.soldier.has_shot:
		_shot_left_s = FLASH_S
	for i: int in _fighters.size():
		if _fighters[i].pain > 0.0:
			_pain_left_s[i] = FLASH_S
	for i: int in 2:
		if _game.zombies[i].has_bitten:
			_bite_left_s[i] = FLASH_S


func _draw_sight(i: int) -> void:
	var fighter := _fighters[i]
	if not fighter.is_alive() or fighter.observation.is_empty():
		return
	var hits := fighter.observation.slice(Fighter.ENEMIES_AT, Fighter.ENEMIES_AT + Fighter.NUM_RAYS)
	Room.draw_rays(self, fighter, _glides[i].place(), hits, _color(i))


func _draw_fighter(i: int) -> void:
	var place := _glides[i].place()
	var fighter := _fighters[i]
	if not fighter.is_alive():
		_draw_dead(place)
		return
	if i > 0 and _bite_left_s[i - 1] > 0.0:
		var share := 1.0 - _bite_left_s[i - 1] / FLASH_S
		var reach := lerpf(Fighter.RADIUS, Zombie.BITE - Fighter.RADIUS, share)
		draw_arc(place, reach, 0.0, TAU, 48, Color(PAIN_COLOR, 0.7 * (1.0 - share)), 4.0, true)
	if i == 0:
		_draw_barrel(place, fighter.rotation)
	var color := _color(i)
	if _pain_left_s[i] > 0.0:
		color = color.lerp(PAIN_COLOR, _pain_left_s[i] / FLASH_S)
	Room.draw_body(self, place, fighter.rotation, color)


func _draw_barrel(place: Vector2, rotation_rad: float) -> void:
	var way := Vector2.from_angle(rotation_rad)
	var side := way.orthogonal() * -9.0
	draw_line(place + side, place + side + way * 42.0, Color(0.75, 0.8, 0.9), 6.0, true)
	draw_line(place + side + way * 42.0, place + side + way * 48.0, Room.INK_COLOR, 4.0, true)


func _draw_dead(place: Vector2) -> void:
	draw_circle(place, Fighter.RADIUS, Color(DEAD_COLOR, 0.7), true, -1.0, true)
	for side: float in [-1.0, 1.0]:
		var arm := Vector2(9.0, 9.0 * side)
		draw_line(place - arm, place + arm, Color(0.6, 0.65, 0.7), 4.0, true)


func _draw_shot() -> void:
	if _shot_left_s <= 0.0:
		return
	var share := _shot_left_s / FLASH_S
	var soldier := _game.soldier
	# The soldier has turned and walked since.
	var way := soldier.shot_start.direction_to(soldier.shot_end)
	var muzzle := soldier.shot_start + way * Fighter.RADIUS * 1.5
	var width := 2.0 * Soldier.SHOT_RADIUS
	draw_line(muzzle, soldier.shot_end, Color(SHOT_COLOR, 0.3 * share), width, true)
	draw_line(muzzle, soldier.shot_end, Color(SHOT_COLOR, share), 2.5, true)
	draw_circle(muzzle, 9.0 * share, Color(SHOT_COLOR, share), true, -1.0, true)
	draw_circle(soldier.shot_end, 13.0 * share, Color(SHOT_COLOR, 0.8 * share), true, -1.0, true)


func _draw_health(fighter: Fighter, place: Vector2) -> void:
	if not fighter.is_alive():
		return
	var corner := place + Vector2(-BAR_SIZE.x / 2.0, -BAR_LIFT)
	draw_rect(Rect2(corner, BAR_SIZE).grow(1.5), Room.INK_COLOR)
	var color := PAIN_COLOR.lerp(Color(0.45, 0.95, 0.55), fighter.health)
	draw_rect(Rect2(corner, Vector2(BAR_SIZE.x * fighter.health, BAR_SIZE.y)), color)


## The magazine as a row of ticks under the health; while it reloads, a ring that closes.
func _draw_rifle(place: Vector2) -> void:
	var soldier := _game.soldier
	if not soldier.is_alive():
		return
	if soldier.reload_delay > 0:
		var share := 1.0 - float(soldier.reload_delay) / Soldier.RELOAD_DELAY
		draw_arc(place, 28.0, 0.0, TAU, 48, Color(SHOT_COLOR, 0.2), 4.0, true)
		draw_arc(place, 28.0, -PI / 2.0, -PI / 2.0 + TAU * share, 48, SHOT_COLOR, 4.0, true)
		return
	var pitch := BAR_SIZE.x / Soldier.NUM_SHOTS
	for i: int in soldier.num_shots:
		var at := place + Vector2(-BAR_SIZE.x / 2.0 + (i + 0.5) * pitch, -BAR_LIFT + 9.0)
		draw_line(at, at + Vector2(0.0, 4.0), SHOT_COLOR, 1.3)


func _color(i: int) -> Color:
	return SOLDIER_COLOR if i == 0 else ZOMBIE_COLOR
