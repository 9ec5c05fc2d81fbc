@tool
extends OptionButton
## The runs of the project, the newest first; one of them is chosen.

## Where they are.
const FOLDER := "res://runs"


func _init() -> void:
	tooltip_text = "The run that is evaluated, played, filmed and used."


## Lists the runs that there are now, and chooses one by name, or else the newest.
func refresh(chosen: String = "") -> void:
	var folder := ProjectSettings.globalize_path(FOLDER)
	var names: Array[String] = []
	if DirAccess.dir_exists_absolute(folder):
		names.assign(DirAccess.get_directories_at(folder))
	var times: Dictionary[String, int] = {}
	for run_name: String in names:
		var settings := folder.path_join(run_name).path_join("config.json")
		if FileAccess.file_exists(settings):
			times[run_name] = FileAccess.get_modified_time(settings)
	names.assign(times.keys())
	names.sort_custom(func(one: String, other: String) -> bool: return times[one] > times[other])
	clear()
	for run_name: String in names:
		add_item(run_name)
		if run_name == chosen:
			select(item_count - 1)


## The folder of the run that is chosen; empty if there is none.
func chosen_folder() -> String:
	if selected < 0:
		return ""
	return ProjectSettings.globalize_path(FOLDER).path_join(get_item_text(selected))
