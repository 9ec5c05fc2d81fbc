extends RefCounted
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
static func read(folder: String, policy_name: String) -> RefCounted:
	var golden: RefCounted = new()
	var path := folder.path_join("policies").path_join(policy_name)
	var cases: Dictionary = JSON.parse_string(FileAccess.get_file_as_string(path + ".cases.json"))
	golden.set("name", policy_name)
	golden.set("policy", LudusPolicy.load_file(path + ".ludus.json"))
	golden.set("steps", cases["steps"])
	golden.set("num_agents", int(cases["num_agents"]))
	return golden


## Returns the names of all golden policies.
static func names(folder: String) -> PackedStringArray:
	var found := PackedStringArray()
	for file: String in DirAccess.get_files_at(folder.path_join("policies")):
		if file.ends_with(".ludus.json"):
			found.append(file.trim_suffix(".ludus.json"))
	return found


## The bytes of all entries in a case, in order.
func observed(step: int) -> Array[PackedByteArray]:
	var found: Array[PackedByteArray] = []
	for entry: LudusObservationEntry in policy.reader().entries:
		var numbers := floats(steps[step]["observation"][entry.name])
		match entry.dtype:
			LudusObservationEntry.DType.UINT8:
				found.append(PackedByteArray(Array(numbers)))
			LudusObservationEntry.DType.INT64:
				found.append(PackedInt64Array(Array(numbers)).to_byte_array())
			_:
				found.append(numbers.to_byte_array())
	return found


## The rows of a table, one after the other.
static func floats(rows: Array) -> PackedFloat32Array:
	var found := PackedFloat32Array()
	for row: Array in rows:
		found.append_array(PackedFloat32Array(row))
	return found
