extends Spatial
## Draws the robot, turned to where it went last, and what its rays meet.

## How fast the robot turns, shares of the angle per second.
const TURN_RATE := 12.0

## One metre of a ray, along z.
export var ray_mesh: Mesh
## Of rays that meet furniture or nothing.
export var obstacle_material: Material
## Of rays that meet the apple.
export var target_material: Material

var _rays: Array = []

onready var _game: Spatial = get_node("../..")
onready var _figure: Spatial = $Figure


func _ready() -> void:
	var num_rays: int = _game.NUM_RAYS
	for i in num_rays:
		var ray := MeshInstance.new()
		ray.mesh = ray_mesh
		ray.cast_shadow = GeometryInstance.SHADOW_CASTING_SETTING_OFF
		$Rays.add_child(ray)
		_rays.append(ray)


func _process(delta: float) -> void:
	var heading: Vector3 = _game.heading
	var angle := atan2(-heading.x, -heading.z)
	_figure.rotation.y = lerp_angle(_figure.rotation.y, angle, min(TURN_RATE * delta, 1.0))
	for i in _rays.size():
		_draw_ray(i)


func _draw_ray(i: int) -> void:
	var length: float = _game.distances_to_obstacle[i]
	var is_target: bool = _game.distances_to_target[i] < _game.SIGHT
	var turned := Basis(Vector3.DOWN, TAU * i / _rays.size() - PI / 2.0)
	var along := turned.z
	_rays[i].material_override = target_material if is_target else obstacle_material
	_rays[i].transform = Transform(
		Basis(turned.x, turned.y, turned.z * length), along * length / 2.0
	)
