extends "ludus_test.gd"
## GDScript reads and writes every golden frame.

const Golden := preload("golden.gd")
const StubAgent := preload("stub_agent.gd")

const JSON_TYPES := [
	LudusWire.Type.HELLO,
	LudusWire.Type.WELCOME,
	LudusWire.Type.SPEC,
	LudusWire.Type.CALL,
	LudusWire.Type.RESULT,
	LudusWire.Type.ERROR,
	LudusWire.Type.CHALLENGE,
	LudusWire.Type.PROOF,
]
const RAW_TYPES := [LudusWire.Type.PING, LudusWire.Type.PONG, LudusWire.Type.CLOSE]


func test_headers() -> void:
	for golden in _all():
		equal(LudusWire.read_u32(golden.frame, 0), golden.payload().size(), golden.name)
		equal(int(golden.frame[4]), golden.type, golden.name)


func test_there_is_one_of_every_type() -> void:
	var types := []
	for golden in _all():
		types.append(golden.type)
	for type in range(1, LudusWire.Type.size()):
		check(type in types, "no golden frame of type %d" % type)


func test_json_is_read() -> void:
	for golden in _of(JSON_TYPES):
		equal(LudusWire.read_json(golden.payload()), golden.content, golden.name)


func test_json_is_written() -> void:
	for golden in _of(JSON_TYPES):
		var frame := LudusWire.json_frame(golden.type, golden.content)
		equal(LudusWire.read_u32(frame, 0), frame.size() - LudusWire.HEADER_BYTES, golden.name)
		equal(frame.subarray(4, 7), golden.frame.subarray(4, 7), golden.name)
		equal(LudusWire.read_json(frame.subarray(8, -1)), golden.content, golden.name)


func test_proofs_are_made() -> void:
	var ours := LudusGreeting.read_hex(Golden.new(golden_folder, "hello").content["nonce"])
	var theirs := LudusGreeting.read_hex(Golden.new(golden_folder, "challenge").content["nonce"])
	for golden in _of([LudusWire.Type.CHALLENGE, LudusWire.Type.PROOF, LudusWire.Type.ERROR]):
		if golden.token.empty():
			continue
		var role := "engine" if golden.type == LudusWire.Type.PROOF else "trainer"
		var proof := LudusGreeting.proof(golden.token, role, ours, theirs)
		equal(proof.hex_encode(), golden.content["proof"], golden.name)


func test_raw_frames_are_written() -> void:
	for golden in _of(RAW_TYPES):
		var payload := _from_hex(golden.content["payload_hex"])
		equal(LudusWire.raw_frame(golden.type, payload), golden.frame, golden.name)


func test_reset_is_read() -> void:
	for golden in _of([LudusWire.Type.RESET]):
		var seeds := _seeds(golden)
		var read := LudusWire.read_reset(golden.payload(), seeds.size())
		equal(read.get("seeds"), seeds, golden.name)
		equal(PoolByteArray(read.get("actions")), _bytes_of(golden.content["actions"]), golden.name)
		equal(read.get("parameters"), golden.content["parameters"], golden.name)


func test_reset_is_written() -> void:
	for golden in _of([LudusWire.Type.RESET]):
		var actions := _bytes_of(golden.content["actions"])
		var parameters = golden.content["parameters"]
		var frame := LudusWire.reset_frame(_seeds(golden), actions, parameters)
		equal(frame.hex_encode(), golden.frame.hex_encode(), golden.name)


func test_step_is_read() -> void:
	for golden in _of([LudusWire.Type.STEP]):
		var offset := 0
		for policy in golden.spec["policies"]:
			var batch := _batch_of(policy)
			batch.activate_all()
			var end := batch.read_actions(golden.payload(), offset)
			batch.hand_out_actions()
			equal(end - offset, batch.action_bytes(), golden.name)
			offset = end
			var actions: Dictionary = golden.content["policies"][policy["name"]]
			for slot in batch.agents.size():
				_check_action(golden.name, batch.agents[slot], actions, slot)
		equal(offset, golden.payload().size(), golden.name)


func test_batch_is_written() -> void:
	for golden in _of([LudusWire.Type.BATCH]):
		var body := PoolByteArray()
		var batches := []
		for policy in golden.spec["policies"]:
			var batch := _batch_of(policy)
			_live_through(batch, golden.content["policies"][policy["name"]])
			body.append_array(batch.to_bytes())
			batches.append(batch)
		for batch in batches:
			body.append_array(batch.final_to_bytes())
			equal(batch.error, "", golden.name)
		equal(_frame_of(golden.content, body).hex_encode(), golden.frame.hex_encode(), golden.name)


func _all() -> Array:
	var frames := []
	for name in Golden.names(golden_folder):
		frames.append(Golden.new(golden_folder, name))
	return frames


func _of(types: Array) -> Array:
	var frames := []
	for golden in _all():
		if golden.type in types:
			frames.append(golden)
	return frames


func _from_hex(text: String) -> PoolByteArray:
	var bytes := PoolByteArray()
	for i in text.length() / 2:
		bytes.append(("0x" + text.substr(2 * i, 2)).hex_to_int())
	return bytes


func _bytes_of(numbers: Array) -> PoolByteArray:
	return PoolByteArray(numbers)


func _seeds(golden: Golden) -> Array:
	var seeds := []
	for text in golden.content["seeds"]:
		seeds.append(("0x" + text.left(8)).hex_to_int() << 32 | ("0x" + text.right(8)).hex_to_int())
	return seeds


func _frame_of(content: Dictionary, body: PoolByteArray) -> PoolByteArray:
	var flags := LudusWire.FLAG_RESET if content["is_reset"] else 0
	flags |= LudusWire.FLAG_REQUESTS if content["has_requests"] else 0
	return LudusWire.batch_frame(
		int(content["tick"]),
		int(content["engine_us"]),
		int(content["bridge_us"]),
		int(content["wait_us"]),
		flags,
		body
	)


## Makes a policy of stub agents from its JSON.
func _batch_of(policy: Dictionary) -> LudusPolicyBatch:
	var agents := []
	var worlds := PoolIntArray()
	for slot in policy["agents"]:
		agents.append(null if slot["path"] == null else _agent_of(policy))
		worlds.append(int(slot["world"]))
	return LudusPolicyBatch.new(policy["name"], agents, worlds, 0)


func _agent_of(policy: Dictionary) -> StubAgent:
	var agent := StubAgent.new()
	agent.has_action_mask = policy["has_action_mask"]
	for entry in policy["observation"]:
		var dtype := LudusObservationEntry.DTYPE_NAMES.find(entry["dtype"])
		var shape := PoolIntArray(entry["shape"])
		agent.observation.append(LudusObservationEntry.create(entry["name"], shape, dtype))
	for part in policy["action"]:
		if part["kind"] == "discrete":
			agent.action.append(LudusActionComponent.discrete(part["name"], int(part["n"])))
		else:
			agent.action.append(LudusActionComponent.continuous(part["name"], int(part["size"])))
	add(agent)
	equal(agent.connect_to_game(), "", "a stub agent")
	return agent


## Compares what an agent was given with its row of the arrays.
func _check_action(what: String, agent: StubAgent, actions: Dictionary, slot: int) -> void:
	if agent == null:
		return
	var choices := PoolIntArray(actions["discrete"][slot] if actions["discrete"] else [])
	var numbers := PoolRealArray(actions["continuous"][slot] if actions["continuous"] else [])
	var expected = numbers if choices.empty() else choices
	if choices.size() == 1 and numbers.empty():
		expected = choices[0]
	elif not choices.empty() and not numbers.empty():
		expected = _by_name(agent, choices, numbers)
	equal(agent.applied, [expected], "%s, slot %d" % [what, slot])


func _by_name(agent: StubAgent, choices: PoolIntArray, numbers: PoolRealArray) -> Dictionary:
	var by_name := {}
	var num_choices := 0
	var num_numbers := 0
	for part in agent.action:
		if part.kind == LudusActionComponent.Kind.DISCRETE:
			by_name[part.name] = choices[num_choices]
			num_choices += 1
		else:
			var own := Array(numbers).slice(num_numbers, num_numbers + part.size - 1)
			by_name[part.name] = PoolRealArray(own)
			num_numbers += part.size
	return by_name


## Lets a policy live through the step that the content of a frame reports.
func _live_through(batch: LudusPolicyBatch, content: Dictionary) -> void:
	var final: Dictionary = content["final"]
	for slot in batch.agents.size():
		var row: int = final["slots"].find(float(slot))
		if row >= 0 or content["reward"][slot] != 0.0:
			batch.activate(slot)
		if batch.agents[slot] != null:
			_tell_step(batch.agents[slot], content, slot, row)
	batch.collect_outcomes()
	for slot in batch.agents.size():
		if content["active"][slot] == 1.0:
			batch.activate(slot)
		var agent: StubAgent = batch.agents[slot]
		if agent != null:
			agent.seen = _observation_of(agent, content["observation"], slot)


func _tell_step(agent: StubAgent, content: Dictionary, slot: int, row: int) -> void:
	agent.reward = content["reward"][slot]
	agent.is_over = content["terminated"][slot] == 1.0
	agent.is_cut = content["truncated"][slot] == 1.0
	agent.mask = PoolByteArray(content["action_mask"][slot] if agent.has_action_mask else [])
	if row >= 0:
		agent.seen = _observation_of(agent, content["final"]["observation"], row)


## A row of every entry, as a game would return it: flat if there is one entry only.
func _observation_of(agent: StubAgent, observation: Dictionary, row: int):
	var by_name := {}
	for entry in agent.observation:
		var numbers := _flattened(observation[entry.name][row])
		match entry.dtype:
			LudusObservationEntry.DType.FLOAT32:
				by_name[entry.name] = PoolRealArray(numbers)
			LudusObservationEntry.DType.UINT8:
				by_name[entry.name] = PoolByteArray(numbers)
			LudusObservationEntry.DType.INT64:
				by_name[entry.name] = numbers
	return by_name.values()[0] if agent.observation.size() == 1 else by_name


func _flattened(value) -> Array:
	if not value is Array:
		return [value]
	var numbers := []
	for item in value:
		numbers.append_array(_flattened(item))
	return numbers
