extends Node2D
## A walled arena in which sixteen chasers run after their balls, each after its own.
##
## The chasers are the agents (chaser.gd); the arena only knows where there is room. Everything is
## local to this node, so that copies fit into one physics space.

const InWindow := preload("res://examples/shared/in_window.gd")

## Inside of the outer walls, pixels.
const INSIDE := Rect2(0.0, 0.0, 1280.0, 720.0)
## Nothing starts nearer to a wall than this, pixels.
const CLEARANCE := 30.0

var _blocked: Array[Rect2] = []


func _enter_tree() -> void:
	LudusWorld.of(self)
	_blocked.clear()
	for wall: Node in $Walls.get_children():
		_blocked.append(wall_rect(wall as CollisionShape2D).grow(CLEARANCE))


func _ready() -> void:
	InWindow.show(self)


## Draws a place with room around it, pixels in the arena.
func random_place(rng: RandomNumberGenerator) -> Vector2:
	while true:
		var place := INSIDE.position + Vector2(rng.randf(), rng.randf()) * INSIDE.size
		if _is_free(place):
			return place
	return INSIDE.get_center()


## Returns the rectangle of a wall, pixels in the arena.
static func wall_rect(wall: CollisionShape2D) -> Rect2:
	var size := (wall.shape as RectangleShape2D).size
	return Rect2(wall.position - size / 2.0, size)


func _is_free(place: Vector2) -> bool:
	for rect: Rect2 in _blocked:
		if rect.has_point(place):
			return false
	return true
