extends AIBaseEnvironment

@export var state_label: Label

var _sims_to_display: Array[PointSimulation] = []
var _only_play: Dictionary = {}


# As the environments of godot-ai choose who trains.
func _input(event):
	if event is InputEventKey and event.is_pressed():
		match event.keycode:
			KEY_7, KEY_KP_7:
				_only_play = {"walker": false, "drifter": true}
			KEY_8, KEY_KP_8:
				_only_play = {"walker": true, "drifter": false}
			KEY_9, KEY_KP_9:
				_only_play = {"walker": false, "drifter": false}
			KEY_0, KEY_KP_0:
				_only_play = {"walker": true, "drifter": true}


func _draw():
	for sim in _sims_to_display:
		if sim._is_cleaned:
			continue
		for i in range(sim.get_agents_count()):
			var state = sim.get_state(i)
			draw_circle(Vector2(state[0], state[1]) * 100.0, 5.0, Color.INDIAN_RED)
			draw_circle(Vector2(state[2], state[3]) * 100.0, 15.0, Color.SEA_GREEN, false)


func display_simulation(s: BaseSimulation):
	PointLog.write("display %d" % s.id)
	await get_tree().physics_frame
	_sims_to_display.append(s)
	while _sims_to_display.size() > get_number_of_simulations_to_display():
		_sims_to_display.pop_front()
	queue_redraw()


func new_simulation() -> BaseSimulation:
	return PointSimulation.new() as PointSimulation


func get_number_of_simulations_to_display() -> int:
	return 3


func get_simulation_count() -> int:
	return 8


func get_steps_in_round() -> int:
	return 10


func get_state_dim(_agent_name: String) -> int:
	return 4


func get_action_dim(_agent_name: String) -> int:
	return 2


func get_batch_size(_agent_name: String) -> int:
	return 128


func get_num_actor_layers(_agent_name: String) -> int:
	return 1


func get_num_critic_layers(_agent_name: String) -> int:
	return 2


func get_hidden_size(_agent_name: String) -> int:
	return 48


func get_replay_capacity(agent_name) -> int:
	return 5_000 if agent_name == "walker" else 100


func get_train_steps(_agent_name: String) -> int:
	return 25


func get_agent_names() -> Array[String]:
	return ["walker", "drifter"]


func get_is_deterministic_map(epoch: int) -> Dictionary:
	PointLog.write("map %d" % epoch)
	if !_only_play.is_empty():
		return _only_play
	if OS.has_environment("POINT_TURNS"):
		return {"walker": epoch % 2 == 0, "drifter": epoch % 2 == 1}
	var learns_from = OS.get_environment("POINT_DRIFTER_LEARNS_FROM")
	return {"walker": false, "drifter": learns_from.is_empty() or epoch < int(learns_from)}


func update_status(epoch: int, message: String):
	PointLog.write("status %d %s" % [epoch, message])
	state_label.text = "%d %s" % [epoch, message]
