extends RefCounted
## A round body in a [code]walled_map.gd[/code]: where it is, what it sees, and what it remembers.
##
## An observation is [code][senses | last 10 senses | last 10 actions][/code], newest first, zeros
## where there are none yet. It is one packed array that moves on by slices.

const Map := preload("res://examples/shared/walled_map.gd")

## Radius of the body, pixels.
const RADIUS := 20.0
## Distance that reads as 1, pixels: a little less than the diagonal of the room.
const SIGHT := 700.0
## Steps remembered.
const NUM_REMEMBERED := 10

## Pixels from the middle of the room.
var place := Vector2.ZERO
## Direction the body looks to, radians, −π to π.
var rotation: float = 0.0
## What it does in this step, each number from −1 to 1.
var action: PackedFloat32Array = []
## What it senses now and remembers; handed out as it is, so never write to it.
var observation: PackedFloat32Array = []
## Unit vectors of the rays, and their distances to the walls in pixels, as last seen.
var rays: PackedVector2Array = []
var ray_lengths: PackedFloat32Array = []

var _senses_size: int = 0
var _action_size: int = 0


func _init(senses_size: int, action_size: int) -> void:
	_senses_size = senses_size
	_action_size = action_size
	action.resize(action_size)


## Numbers in an observation.
static func observation_size(senses_size: int, action_size: int) -> int:
	return senses_size + NUM_REMEMBERED * (senses_size + action_size)


## Returns unit vectors for the angles of rays, fractions of π from straight ahead.
static func fan(fractions: PackedFloat64Array) -> PackedVector2Array:
	var directions := PackedVector2Array()
	for fraction: float in fractions:
		directions.append(Vector2.from_angle(fraction * PI))
	return directions


## Begins an episode somewhere, remembering nothing.
func begin(at: Vector2, looking: float) -> void:
	place = at
	rotation = wrapf(looking, -PI, PI)
	action.fill(0.0)
	observation = PackedFloat32Array()


## Takes what to do next. Numbers beyond −1 and 1 are cut off.
func take_action(numbers: PackedFloat32Array) -> void:
	for i: int in _action_size:
		action[i] = clampf(numbers[i], -1.0, 1.0)


## Moves straight until a wall, at most [param step] pixels for each unit of the action.
func walk(map: Map, step: float) -> void:
	place = map.move(place, Vector2(action[0], action[1]) * step, RADIUS)


## Looks along [param directions], given for a body that looks along +x.
func look(map: Map, directions: PackedVector2Array) -> void:
	rays = Transform2D(rotation, Vector2.ZERO) * directions
	ray_lengths = map.distances(place, rays)


## Writes what the rays, [param width] pixels to each side, find of bodies at [param others] into
## [param senses] from [param offset] on: the distance over [constant SIGHT], 1 if a wall hides them
## or none is met.
func see(
	others: PackedVector2Array, senses: PackedFloat32Array, offset: int, width: float = 0.0
) -> void:
	for other: Vector2 in others:
		var way := other - place
		var beyond := (RADIUS + width) * (RADIUS + width) - way.length_squared()
		var i := offset
		for ray: Vector2 in rays:
			var along := way.dot(ray)
			var room := beyond + along * along
			if room >= 0.0 and along > 0.0:
				var distance := maxf(along - sqrt(room), 0.0)
				if distance < ray_lengths[i - offset]:
					senses[i] = minf(senses[i], distance / SIGHT)
			i += 1


## Turns fresh senses into the observation; what was sensed and done before moves back by a step.
## [param senses] is taken over.
func remember(senses: PackedFloat32Array) -> void:
	var actions_at := _senses_size * (1 + NUM_REMEMBERED)
	var next := senses
	if observation.is_empty():
		next.resize(observation_size(_senses_size, _action_size))
	else:
		next.append_array(observation.slice(0, actions_at - _senses_size))
		next.append_array(action)
		next.append_array(observation.slice(actions_at, observation.size() - _action_size))
	observation = next
