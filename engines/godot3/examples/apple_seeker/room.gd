extends StaticBody
## Walls and furniture of the room: boxes that stop the robot, and a surface that stops its rays.
##
## Bullet rounds the edges of a box, by its margin of 4 cm, and where a ray meets such an edge
## depends on how far from the origin it is. Triangles are met where they are; but sliding along
## them costs ten times as much.

## Layer of the surface that stops rays; the boxes are in the first one.
const SURFACE_LAYER := 8
## Half the room along x and z, metres.
const HALF_SIZE := Vector2(4.0, 3.0)
const WALL_HEIGHT := 1.2
const WALL_THICKNESS := 0.2
## Middle of the foot and size of each piece of furniture, metres.
const SOFA := [Vector3(-2.0, 0.0, -2.55), Vector3(2.2, 1.0, 0.9)]
const TABLE := [Vector3(0.4, 0.0, -0.1), Vector3(1.8, 0.8, 1.0)]
const SHELF := [Vector3(2.2, 0.0, 2.0), Vector3(0.4, 1.5, 2.0)]
const CRATE := [Vector3(2.7, 0.0, -1.3), Vector3(0.9, 0.9, 0.9)]
const PLANT := [Vector3(-2.5, 0.0, 1.5), Vector3(0.7, 0.8, 0.7)]
## Corners of the sides of a box, in halves of its size, two by two along its foot.
const _FOOT := [Vector2(-1, -1), Vector2(1, -1), Vector2(1, 1), Vector2(-1, 1)]


## Returns middle of the foot and size of everything that stops the robot and its rays.
static func boxes() -> Array:
	return walls() + [SOFA, TABLE, SHELF, CRATE, PLANT]


## Returns the same of the four walls: left, right, back, front.
static func walls() -> Array:
	var side := Vector3(WALL_THICKNESS, WALL_HEIGHT, 2.0 * (HALF_SIZE.y + WALL_THICKNESS))
	var end := Vector3(2.0 * HALF_SIZE.x, WALL_HEIGHT, WALL_THICKNESS)
	var x := HALF_SIZE.x + WALL_THICKNESS / 2.0
	var z := HALF_SIZE.y + WALL_THICKNESS / 2.0
	return [
		[Vector3(-x, 0.0, 0.0), side],
		[Vector3(x, 0.0, 0.0), side],
		[Vector3(0.0, 0.0, -z), end],
		[Vector3(0.0, 0.0, z), end],
	]


func _init() -> void:
	var faces := PoolVector3Array()
	for box in boxes():
		var solid := BoxShape.new()
		solid.extents = box[1] / 2.0
		_add_shape(self, solid, box[0] + Vector3(0.0, solid.extents.y, 0.0))
		faces.append_array(_sides(box[0], box[1]))
	var surface := ConcavePolygonShape.new()
	surface.set_faces(faces)
	var skin := StaticBody.new()
	skin.collision_layer = SURFACE_LAYER
	skin.collision_mask = 0
	_add_shape(skin, surface, Vector3.ZERO)
	add_child(skin)


static func _add_shape(body: StaticBody, shape: Shape, place: Vector3) -> void:
	var collision := CollisionShape.new()
	collision.shape = shape
	collision.translation = place
	body.add_child(collision)


## Two triangles for each of the four sides; nothing comes from above.
static func _sides(foot: Vector3, size: Vector3) -> PoolVector3Array:
	var faces := PoolVector3Array()
	var up := Vector3(0.0, size.y, 0.0)
	for i in _FOOT.size():
		var from := foot + _corner(_FOOT[i], size)
		var to := foot + _corner(_FOOT[(i + 1) % _FOOT.size()], size)
		faces.append_array([from, to, to + up, from, to + up, from + up])
	return faces


static func _corner(corner: Vector2, size: Vector3) -> Vector3:
	return Vector3(corner.x * size.x, 0.0, corner.y * size.z) / 2.0
