extends Reference
## One golden policy of [code]protocol/golden/policies[/code] with its cases (POLICY.md §6).

## File name without suffix.
var name: String
## The policy.
var policy: LudusPolicy
## Its cases, one after the other.
var steps: Array
## Rows of every case.
var num_agents: int


## Reads a golden policy.
func _init(folder: String, policy_name: String) -> void:
	var path := folder.plus_file("policies").plus_file(policy_name)
	var file := File.new()
	var _error := file.open(path + ".cases.json", File.READ)
	var cases: Dictionary = JSON.parse(file.get_as_text()).result
	name = policy_name
	policy = LudusPolicy.load_file(path + ".ludus.json")
	steps = cases["steps"]
	num_agents = int(cases["num_agents"])


## Returns the names of all golden policies.
static func names(folder: String) -> Array:
	var found := []
	var directory := Directory.new()
	if directory.open(folder.plus_file("policies")) != OK or directory.list_dir_begin(true) != OK:
		return found
	var file := directory.get_next()
	while not file.empty():
		if file.ends_with(".ludus.json"):
			found.append(file.trim_suffix(".ludus.json"))
		file = directory.get_next()
	found.sort()
	return found


## What the network takes in a case: the numbers of all vector entries, in order, or the bytes of
## all image entries.
func observed(step: int, frames: LudusPolicyFrames, are_images: bool) -> Array:
	var found := []
	for i in policy.reader().entries.size():
		var entry: Resource = policy.reader().entries[i]
		if LudusPolicyReader.is_image(entry) == are_images:
			var numbers = flat(steps[step]["observation"][entry.name])
			if are_images:
				numbers = PoolByteArray(numbers)
			found.append(frames.push(i, numbers, entry.size()))
	return found


## The rows of a table, one after the other.
static func flat(rows: Array) -> Array:
	var found := []
	for row in rows:
		found.append_array(row)
	return found
