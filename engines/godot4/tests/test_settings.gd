extends "ludus_test.gd"
## Training settings in the scene, as they travel in the handshake.


func test_what_is_not_set_is_left_to_the_trainer() -> void:
	equal(LudusPolicySettings.new().to_json(), {}, "new settings")


func test_settings_of_ppo() -> void:
	var settings := LudusPolicySettings.new()
	settings.algorithm = LudusPolicySettings.Algorithm.PPO
	settings.activation = LudusPolicySettings.Activation.SILU
	settings.mode = LudusPolicySettings.Mode.FROZEN
	settings.hidden_sizes = [32, 16]
	settings.frame_stack = 4
	settings.memory_size = 0
	settings.entropy_coefficient = 0.0
	settings.batch_size = 99
	equal(
		settings.to_json(),
		{
			"algorithm": "ppo",
			"mode": "frozen",
			"activation": "silu",
			"hidden_sizes": [32, 16],
			"frame_stack": 4,
			"memory_size": 0,
			"entropy_coefficient": 0.0,
		},
		"without the batch size, which is SAC's"
	)


func test_settings_of_sac() -> void:
	var settings := LudusPolicySettings.new()
	settings.algorithm = LudusPolicySettings.Algorithm.SAC
	settings.critic_hidden_sizes = [200, 200]
	settings.replay_capacity = 5000
	settings.updates_per_step = 0.5
	settings.discount = 0.5
	settings.epochs = 3
	settings.more = {"target_rate": 0.25, "discount": 0.75}
	equal(
		settings.to_json(),
		{
			"algorithm": "sac",
			"critic_hidden_sizes": [200, 200],
			"discount": 0.75,
			"replay_capacity": 5000,
			"updates_per_step": 0.5,
			"target_rate": 0.25,
		},
		"what stands in `more` wins"
	)


func test_the_inspector_shows_what_the_algorithm_knows() -> void:
	var settings := LudusPolicySettings.new()
	equal(_shown(settings, "batch_size"), false, "without a choice")
	equal(_shown(settings, "epochs"), true, "without a choice")
	settings.algorithm = LudusPolicySettings.Algorithm.SAC
	equal(_shown(settings, "batch_size"), true, "SAC")
	equal(_shown(settings, "epochs"), false, "SAC")
	equal(_shown(settings, "hidden_sizes"), true, "SAC")


func _shown(settings: LudusPolicySettings, name: String) -> bool:
	for property: Dictionary in settings.get_property_list():
		if property["name"] == name:
			return int(property["usage"]) & PROPERTY_USAGE_EDITOR != 0
	return false
