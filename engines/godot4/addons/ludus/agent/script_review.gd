extends RefCounted
## Finds mistakes in a game's scripts that would otherwise show late, elsewhere or never.
##
## It reads source code, so that it finds nothing in exported games.

## Methods that an agent's node may have beside [constant LudusAgent.REQUIRED_METHODS].
const OPTIONAL_METHODS: Array[StringName] = [
	&"get_action_mask", &"is_truncated", &"get_manual_action"
]
## Calls that need the scene to be the tree's current one, which no copy of it is in training.
const SCENE_CHANGES: PackedStringArray = [
	"reload_current_scene", "change_scene_to_file", "change_scene_to_packed"
]

const _CONTROLLERS: Array[Script] = [
	preload("res://addons/ludus/agent/ludus_controller_2d.gd"),
	preload("res://addons/ludus/agent/ludus_controller_3d.gd"),
]
const _MIN_SIMILARITY := 0.85
const _MIN_SIMILARITY_IF_MISSING := 0.55
const _OWN_FOLDER := "res://addons/ludus"


## Names of a script's methods, those of the scripts that it extends included, but no stubs of a
## controller. The engine lists an inherited method once, and once more where it is overridden.
static func methods_of(script: Script) -> Array[StringName]:
	var names: Array[StringName] = []
	for method: Dictionary in script.get_script_method_list():
		names.append(StringName(str(method["name"])))
	var controller := _controller_of(script)
	if controller != null:
		for stub: Dictionary in controller.get_script_method_list():
			names.erase(StringName(str(stub["name"])))
	return names


## Whether an agent's node has a method of the game.
static func has_game_method(target: Object, method: StringName) -> bool:
	if not target.has_method(method):
		return false
	var script: Script = target.get_script()
	return _controller_of(script) == null or method in methods_of(script)


## The controller that a script extends or is, or null.
static func _controller_of(script: Script) -> Script:
	var base := script
	while base != null and base not in _CONTROLLERS:
		base = base.get_base_script()
	return base


## Whether a script declares what get_reward(), is_done() and is_truncated() return, so that they
## can return nothing else.
static func declares_outcomes(script: Script) -> bool:
	var types: Dictionary[StringName, int] = {}
	var base := script
	while base != null:
		for method: Dictionary in base.get_script_method_list():
			types.get_or_add(StringName(str(method["name"])), method["return"]["type"])
		base = base.get_base_script()
	return (
		types.get(&"get_reward") == TYPE_FLOAT
		and types.get(&"is_done") == TYPE_BOOL
		and types.get(&"is_truncated", TYPE_BOOL) == TYPE_BOOL
	)


## The method that was probably meant to be [param known], or an empty name. It may be less alike
## where [param is_missing] says that something must have been meant.
static func find_misspelt(script: Script, known: StringName, is_missing: bool) -> StringName:
	var names := methods_of(script)
	if known in names:
		return &""
	var best := &""
	var highest := _MIN_SIMILARITY_IF_MISSING if is_missing else _MIN_SIMILARITY
	for name: StringName in names:
		if name in LudusAgent.REQUIRED_METHODS or name in OPTIONAL_METHODS:
			continue
		var similarity := _plain(name).similarity(_plain(known))
		if similarity >= highest:
			best = name
			highest = similarity
	return best


## Says which methods look like misspelt optional ones.
static func misspelt_methods(script: Script) -> PackedStringArray:
	var found := PackedStringArray()
	for known: StringName in OPTIONAL_METHODS:
		var name := find_misspelt(script, known, false)
		if not name.is_empty():
			found.append(
				"%s: %s() is never called; did you mean %s()?" % [script.resource_path, name, known]
			)
	return found


## Says which of an agent's methods waits, or returns an empty text.
static func find_await(script: Script) -> String:
	var base := script
	while base != null:
		var method := ""
		var number := 0
		for line: String in _lines(base):
			number += 1
			if line.begins_with("func ") or line.begins_with("static func "):
				method = line.get_slice("func ", 1).get_slice("(", 0).strip_edges()
			elif not line.is_empty() and not (line[0] in "\t ") and not line.begins_with(")"):
				method = ""
			if _has_word(line, "await") and _is_called_by_ludus(method):
				return (
					"%s:%d: %s() must not wait (await): Ludus goes on before it has finished"
					% [base.resource_path, number, method]
				)
		base = base.get_base_script()
	return ""


## Says where scripts under [param root] change the scene; one line for each script.
static func scene_changes(root: Node) -> PackedStringArray:
	var seen: Dictionary[Script, bool] = {}
	var found := PackedStringArray()
	for node: Node in root.find_children("*", "", true, false) + [root]:
		var script: Script = node.get_script()
		while script != null and not seen.has(script):
			seen[script] = true
			var problem := _scene_change(script)
			if not problem.is_empty():
				found.append(problem)
			script = script.get_base_script()
	return found


## What a method returned, in words.
static func describe_value(value: Variant) -> String:
	if value == null:
		return "nothing (null): does it lack a `return`?"
	var found := type_string(typeof(value))
	return found if typeof(value) < TYPE_ARRAY else "%s of %d" % [found, len(value)]


## Where the methods of an agent are written, for messages: " (res://hero.gd)" or nothing.
static func place_of(target: Object) -> String:
	var script: Script = target.get_script() if target != null else null
	if script == null or script.resource_path.is_empty():
		return ""
	return "" if script.resource_path.begins_with(_OWN_FOLDER) else " (%s)" % script.resource_path


static func _scene_change(script: Script) -> String:
	var number := 0
	for line: String in _lines(script):
		number += 1
		for method: String in SCENE_CHANGES:
			if _has_word(line, method):
				return (
					(
						"%s:%d: %s() does nothing in training, where the scene is one of many copies: "
						% [script.resource_path, number, method]
					)
					+ "let is_done() return true, and put everything back in reset()"
				)
	return ""


static func _is_called_by_ludus(method: String) -> bool:
	return method in LudusAgent.REQUIRED_METHODS or method in OPTIONAL_METHODS


## Lines of code without comments.
static func _lines(script: Script) -> PackedStringArray:
	if not script.has_source_code() or script.resource_path.begins_with(_OWN_FOLDER + "/"):
		return []
	var lines := script.source_code.split("\n")
	for i: int in lines.size():
		lines[i] = lines[i].get_slice("#", 0)
	return lines


static func _has_word(line: String, word: String) -> bool:
	var start := line.find(word)
	if start < 0:
		return false
	var end := start + word.length()
	var is_open := start == 0 or not (line[start - 1] + "a").is_valid_ascii_identifier()
	return is_open and (end == line.length() or not ("a" + line[end]).is_valid_ascii_identifier())


static func _plain(name: StringName) -> String:
	return String(name).to_lower().replace("_", "")
