class_name PointSimulation
extends BaseSimulation

## Two points on a square, each with a goal. A point that reaches its goal is done. Bodies in a
## physics space of its own say where they are.

const STEP_LENGTH = 0.25
const GOAL_RADIUS = 0.15
const PIXELS = 100.0

static var _next_id = 0

var id = 0
var _space: RID
var _bodies: Array[RID] = []
var _shapes: Array[RID] = []
var _goals: Array[Vector2] = [Vector2.ZERO, Vector2.ZERO]
var _scores: Array[float] = [0.0, 0.0]
var _steps = 0


func _init():
	id = _next_id
	_next_id += 1
	_space = PhysicsServer2D.space_create()
	PhysicsServer2D.space_set_active(_space, true)
	for i in range(get_agents_count()):
		var shape = PhysicsServer2D.circle_shape_create()
		PhysicsServer2D.shape_set_data(shape, 5.0)
		var body = PhysicsServer2D.body_create()
		PhysicsServer2D.body_set_mode(body, PhysicsServer2D.BODY_MODE_KINEMATIC)
		PhysicsServer2D.body_add_shape(body, shape)
		PhysicsServer2D.body_set_collision_layer(body, 1 << i)
		PhysicsServer2D.body_set_space(body, _space)
		_shapes.append(shape)
		_bodies.append(body)


func new_game(physics_update: Signal) -> bool:
	PointLog.write("new %d" % id)
	await physics_update
	while OS.has_environment("POINT_ENDLESS"):
		await physics_update
	for i in range(get_agents_count()):
		var start = Vector2.ZERO
		_goals[i] = Vector2.ZERO
		while start.distance_to(_goals[i]) < GOAL_RADIUS:
			start = Vector2(randf_range(-1.0, 1.0), randf_range(-1.0, 1.0))
			_goals[i] = Vector2(randf_range(-1.0, 1.0), randf_range(-1.0, 1.0))
		_move_to(i, start)
	await physics_update
	await physics_update
	PointLog.write("begun %d found %d" % [id, _count_found()])
	return true


func is_game_complete(agent_index: int) -> bool:
	return _position(agent_index).distance_to(_goals[agent_index]) < GOAL_RADIUS


func apply_action(agent_index: int, action_vector: Array[float], callback):
	_steps += 1
	PointLog.write(
		"act %d %d %d %s" % [id, agent_index, int(is_game_complete(agent_index)), callback]
	)
	var before = _position(agent_index)
	var after = before + Vector2(action_vector[0], action_vector[1]) * STEP_LENGTH
	_move_to(agent_index, after)
	var goal = _goals[agent_index]
	_scores[agent_index] = 10.0 * (before.distance_to(goal) - after.distance_to(goal))


func get_state(agent_index: int) -> Array[float]:
	var p = _position(agent_index)
	var goal = _goals[agent_index]
	return [p.x, p.y, goal.x, goal.y]


func get_score(agent_index: int) -> float:
	return _scores[agent_index]


func cleanup_simulation():
	PointLog.write("clean %d" % id)
	for rid in _bodies + _shapes + [_space]:
		PhysicsServer2D.free_rid(rid)
	_is_cleaned = true


func get_agents_count() -> int:
	return 2


func get_agent_name(agent_index: int) -> String:
	return get_agent_names()[agent_index]


func get_agent_names() -> Array[String]:
	return ["walker", "drifter"]


func _position(agent_index: int) -> Vector2:
	var transform = PhysicsServer2D.body_get_state(
		_bodies[agent_index], PhysicsServer2D.BODY_STATE_TRANSFORM
	)
	return transform.origin / PIXELS


func _move_to(agent_index: int, p: Vector2):
	PhysicsServer2D.body_set_state(
		_bodies[agent_index], PhysicsServer2D.BODY_STATE_TRANSFORM, Transform2D(0, p * PIXELS)
	)


## How many bodies a query finds where they are.
func _count_found() -> int:
	var state = PhysicsServer2D.space_get_direct_state(_space)
	var count = 0
	for i in range(get_agents_count()):
		var query = PhysicsPointQueryParameters2D.new()
		query.position = _position(i) * PIXELS
		query.collision_mask = 1 << i
		count += state.intersect_point(query).size()
	return count
