extends Node3D
## Draws a floor, and each shape of the room as a box in its colour.

const WALL_COLOR := Color(0.594, 0.561, 0.497)
const COLORS := {
	&"Sofa": Color(0.12, 0.365, 0.334),
	&"Table": Color(0.352, 0.229, 0.13),
	&"Shelf": Color(0.311, 0.209, 0.122),
	&"Crate": Color(0.497, 0.393, 0.242),
	&"Plant": Color(0.161, 0.395, 0.202),
}


func _ready() -> void:
	for node: Node in get_parent().get_children():
		if node is CollisionShape3D:
			_draw_box(node as CollisionShape3D)


func _draw_box(collision: CollisionShape3D) -> void:
	var material := StandardMaterial3D.new()
	material.albedo_color = COLORS.get(collision.name, WALL_COLOR)
	material.roughness = 0.8
	var box := BoxMesh.new()
	box.size = (collision.shape as BoxShape3D).size
	box.material = material
	var drawn := MeshInstance3D.new()
	drawn.mesh = box
	drawn.position = collision.position
	add_child(drawn)
