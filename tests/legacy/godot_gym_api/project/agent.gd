extends RLAgent
## A point on a line that moves by the action in every physics frame.

var place: float = 0.0
var move: float = 0.0
var num_frames: int = 0
var scale_of_moves: float = 1.0

onready var _fault: String = OS.get_environment("WALK_FAULT")


func _physics_process(_delta: float) -> void:
	num_frames += 1
	place += move * scale_of_moves


func set_action(action) -> void:
	move = action
	if _is_now("quit"):
		OS.exit_code = 9
		get_tree().quit()
	while _is_now("hang"):
		pass


func reset(arguments = 0.0) -> void:
	place = arguments
	move = 0.0
	num_frames = 0


func configure(agent_config: Dictionary) -> void:
	scale_of_moves = agent_config.get("scale", scale_of_moves)


func get_data(observation_request, storage) -> void:
	if _is_now("script"):
		var nobody: Node = null
		nobody.get_children()
	if not storage is Dictionary:
		storage.set_place(place)
		for number in [num_frames, -num_frames]:
			storage.add_frames(number)
		return
	storage["place"] = NAN if _is_now("nan") else place
	storage["frames"] = [num_frames, -num_frames]
	if "bytes" in observation_request:
		storage["picture"] = PoolByteArray([0, 255, 10])
	if "all" in observation_request:
		storage["small"] = PoolRealArray([1.5e-9, 0.1, -0.25])
		storage["where"] = Vector3(1, 2, 0.5)
		storage["name"] = 'Straße "1"'


func _is_now(fault: String) -> bool:
	return _fault == fault and num_frames >= 8
