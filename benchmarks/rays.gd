extends SceneTree
## Times sixteen agents with sixteen rays each: LudusRays and Godot RL Agents' raycast sensors, in
## turns, in one scene. `benchmarks/rays.py` runs it.
##
## It prints the shortest turn of each: another program may take the processor in any turn, but not
## in all of them.

const NUM_SENSORS := 16
const NUM_RAYS := 16
const NUM_TURNS := 400
const PEER := "res://addons/godot_rl_agents/sensors/"
## Places and sizes of boxes around and between the sensors; pixels in 2D, a tenth of metres in 3D.
const BOXES: Array[Rect2] = [
	Rect2(-20, -20, 1320, 20),
	Rect2(-20, 720, 1320, 20),
	Rect2(-20, 0, 20, 720),
	Rect2(1280, 0, 20, 720),
	Rect2(300, 300, 60, 260),
	Rect2(490, 170, 300, 60),
	Rect2(920, 310, 60, 260),
	Rect2(560, 530, 160, 60),
]
const REACH := 200.0
const METRE := 10.0


func _initialize() -> void:
	_measure.call_deferred()


func _measure() -> void:
	var found := {}
	for dimension: String in ["2d", "3d"]:
		var is_2d := dimension == "2d"
		var ours: Array[Node] = []
		var theirs: Array[Node] = []
		var stage: Node = Node2D.new() if is_2d else Node3D.new()
		root.add_child(stage)
		for box: Rect2 in BOXES:
			stage.add_child(_box_2d(box) if is_2d else _box_3d(box))
		for i: int in NUM_SENSORS:
			var place := Vector2(80 + i % 8 * 160, 90 if i < 8 else 660)
			ours.append(_ours_2d(place) if is_2d else _ours_3d(place))
			theirs.append(_theirs_2d(place) if is_2d else _theirs_3d(place))
			stage.add_child(ours[i])
			stage.add_child(theirs[i])
		for i: int in 3:
			await physics_frame
		found[dimension] = _time(ours, theirs)
		stage.free()
	print("MEASURED ", JSON.stringify(found))
	quit()


## Takes turns; returns the shortest of each in nanoseconds a ray, and the largest difference.
func _time(ours: Array[Node], theirs: Array[Node]) -> Dictionary:
	var shortest := [INF, INF]
	for turn: int in NUM_TURNS:
		for side: int in 2:
			var began := Time.get_ticks_usec()
			if side == 0:
				for sensor: Node in ours:
					sensor.sense()
			else:
				for sensor: Node in theirs:
					sensor.get_observation()
			shortest[side] = minf(shortest[side], Time.get_ticks_usec() - began)
	var num_rays := NUM_SENSORS * NUM_RAYS
	var worst := 0.0
	var num_hits := 0
	for i: int in NUM_SENSORS:
		var one := Array(ours[i].sense())
		var two: Array = theirs[i].get_observation().map(func(x: float) -> float: return 1.0 - x)
		one.sort()
		two.sort()
		for ray: int in NUM_RAYS:
			worst = maxf(worst, absf(one[ray] - two[ray]))
			num_hits += int(one[ray] < 1.0)
	return {
		"ours_ns": shortest[0] * 1000.0 / num_rays,
		"theirs_ns": shortest[1] * 1000.0 / num_rays,
		"difference": worst,
		"hits": float(num_hits) / num_rays,
	}


func _ours_2d(place: Vector2) -> Node:
	var sensor: Node2D = load("res://addons/ludus/sensors/ludus_rays_2d.gd").new()
	sensor.position = place
	sensor.rotation = PI / NUM_RAYS
	sensor.set(&"reach", REACH)
	return sensor


func _theirs_2d(place: Vector2) -> Node:
	var sensor: Node2D = load(PEER + "sensors_2d/RaycastSensor2D.gd").new()
	sensor.position = place
	sensor.set(&"n_rays", NUM_RAYS)
	sensor.set(&"ray_length", REACH)
	return sensor


func _ours_3d(place: Vector2) -> Node:
	var sensor: Node3D = load("res://addons/ludus/sensors/ludus_rays_3d.gd").new()
	sensor.position = Vector3(place.x, 0.0, place.y) / METRE
	sensor.rotation.y = PI / NUM_RAYS
	sensor.set(&"pattern", 1)
	sensor.set(&"reach", REACH / METRE)
	return sensor


func _theirs_3d(place: Vector2) -> Node:
	var sensor: Node3D = load(PEER + "sensors_3d/RaycastSensor3D.gd").new()
	sensor.position = Vector3(place.x, 0.0, place.y) / METRE
	sensor.set(&"n_rays_width", NUM_RAYS)
	sensor.set(&"n_rays_height", 1)
	sensor.set(&"cone_width", 360.0)
	sensor.set(&"ray_length", REACH / METRE)
	return sensor


func _box_2d(box: Rect2) -> StaticBody2D:
	var body := StaticBody2D.new()
	var collision := CollisionShape2D.new()
	var shape := RectangleShape2D.new()
	shape.size = box.size
	collision.shape = shape
	body.position = box.get_center()
	body.add_child(collision)
	return body


func _box_3d(box: Rect2) -> StaticBody3D:
	var body := StaticBody3D.new()
	var collision := CollisionShape3D.new()
	var shape := BoxShape3D.new()
	shape.size = Vector3(box.size.x, METRE, box.size.y) / METRE
	collision.shape = shape
	body.position = Vector3(box.get_center().x, 0.0, box.get_center().y) / METRE
	body.add_child(collision)
	return body
