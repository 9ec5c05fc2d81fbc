extends RefCounted
## How much room the collision shapes of a 2D scene take, before it is in the tree.


## Width and height of all collision shapes below [param root] together, pixels; zero in 3D.
## Boundaries without an end are left out.
static func of(root: Node) -> Vector3:
	var rects: Array[Rect2] = []
	if root is Node2D:
		_gather(root, Transform2D.IDENTITY, rects)
	if rects.is_empty():
		return Vector3.ZERO
	var whole := rects[0]
	for rect: Rect2 in rects:
		whole = whole.merge(rect)
	return Vector3(whole.size.x, whole.size.y, 0.0)


static func _gather(node: Node, place: Transform2D, rects: Array[Rect2]) -> void:
	if node is CollisionShape2D:
		var shape := (node as CollisionShape2D).shape
		if shape != null and shape is not WorldBoundaryShape2D:
			rects.append(place * shape.get_rect())
	elif node is CollisionPolygon2D:
		var points := place * (node as CollisionPolygon2D).polygon
		if not points.is_empty():
			var rect := Rect2(points[0], Vector2.ZERO)
			for point: Vector2 in points:
				rect = rect.expand(point)
			rects.append(rect)
	for child: Node in node.get_children():
		_gather(child, place * (child as Node2D).transform if child is Node2D else place, rects)
