extends Node3D
## Draws a floor, and each shape of the room as a box in its colour.

const WALL_COLOR := Color(0.914, 0.863, 0.765)
const COLORS := {
	&"Sofa": Color(0.184, 0.561, 0.514),
	&"Table": Color(0.541, 0.353, 0.2),
	&"Shelf": Color(0.478, 0.322, 0.188),
	&"Crate": Color(0.765, 0.604, 0.373),
	&"Plant": Color(0.247, 0.608, 0.31),
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
