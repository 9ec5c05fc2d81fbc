extends Node
## What is different for the bridge while the game guides its own training (PROTOCOL.md §8): which
## scene is trained, how fast time passes, who hears how it goes, and what comes after.

const LudusLink := preload("res://addons/ludus/bridge/link.gd")
const LudusStage := preload("res://addons/ludus/world/stage.gd")

## The node that guides; null where the trainer does.
var training: LudusTraining
## Whether the trainer lets the game go on by itself.
var is_standing_by: bool = false

var _pace := LudusPace.new()
## Frame in which the trainer had nothing to say.
var _silent_frame: int = -1


func _init() -> void:
	name = "Guidance"
	process_mode = Node.PROCESS_MODE_ALWAYS
	add_child(_pace)


## Whether the current scene brings a node that looks for a trainer itself.
func is_in_scene() -> bool:
	var scene := get_tree().current_scene
	if scene == null or scene is LudusTraining:
		return scene != null
	return not scene.find_children("*", "LudusTraining", true, false).is_empty()


## What the trainer is told in the greeting; empty where it guides.
func to_json() -> Dictionary:
	return {} if training == null else training.to_json()


## The scene to train, where the trainer names none.
func scene_path() -> String:
	if training != null and not training.scene_path.is_empty():
		return training.scene_path
	var current := get_tree().current_scene
	return current.scene_file_path if current != null and current != get_parent() else ""


## The worlds take the place of the current scene, unless that only names the one to train.
func clear_the_stage() -> void:
	if get_tree().current_scene == get_parent():
		return
	if training == null:
		get_tree().unload_current_scene()
	elif training.scene_path.is_empty():
		training.reparent(self)
		get_tree().unload_current_scene()


## How many worlds to draw.
func num_drawn() -> int:
	return 1 if training == null else training.num_drawn


## Waits a moment for the trainer. Returns false if it has nothing to say; then frames pass, in
## which the game draws and hears its keys, and the worlds stand still unless they stand by.
func hears(link: LudusLink) -> bool:
	if link.wait_for_data(0 if is_standing_by else _pace.patience_ms()):
		return true
	_silent_frame = Engine.get_process_frames()
	get_tree().paused = not is_standing_by
	_pace.note_waiting()
	return false


## Whether the trainer was silent in this frame, so that it is no use to listen again.
func is_silent_frame() -> bool:
	return _silent_frame == Engine.get_process_frames()


## Takes in how training goes.
func show_status(status: Dictionary) -> void:
	if training != null:
		_pace.is_fast = status.get("state", "training") == "training"
		training.take_in(status)


## Goes back to a game without a trainer, after [param message]; brings back the scene whose place
## the worlds of [param stage] took.
func end(message: String, stage: LudusStage) -> void:
	get_tree().paused = false
	_pace.is_fast = false
	is_standing_by = false
	training.take_leave("the trainer has gone" if message.is_empty() else message)
	if training.get_parent() == self:
		training.queue_free()
		get_tree().change_scene_to_packed.call_deferred(stage.scene)
	training = null
	if stage != null:
		stage.queue_free()
