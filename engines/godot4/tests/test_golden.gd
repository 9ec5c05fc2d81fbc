extends "ludus_test.gd"
## GDScript reads and writes every golden frame.

const LudusPolicyBatch := preload("res://addons/ludus/agent/policy_batch.gd")
const LudusGreeting := preload("res://addons/ludus/bridge/greeting.gd")
const LudusWire := preload("res://addons/ludus/bridge/wire.gd")

const Golden := preload("golden.gd")
const StubAgent := preload("stub_agent.gd")

const JSON_TYPES: Array[int] = [
	LudusWire.Type.HELLO,
	LudusWire.Type.WELCOME,
	LudusWire.Type.SPEC,
	LudusWire.Type.CALL,
	LudusWire.Type.RESULT,
	LudusWire.Type.ERROR,
	LudusWire.Type.CHALLENGE,
	LudusWire.Type.PROOF,
]
const RAW_TYPES: Array[int] = [LudusWire.Type.PING, LudusWire.Type.PONG, LudusWire.Type.CLOSE]


func test_headers() -> void:
	for golden: Golden in _all():
		equal(golden.frame.decode_u32(0), golden.payload().size(), golden.name)
		equal(int(golden.frame[4]), golden.type, golden.name)


func test_there_is_one_of_every_type() -> void:
	var types: Array[int] = []
	for golden: Golden in _all():
		types.append(golden.type)
	for type: int in range(1, LudusWire.Type.size()):
		check(type in types, "no golden frame of type %d" % type)


func test_json_is_read() -> void:
	for golden: Golden in _of(JSON_TYPES):
		equal(LudusWire.read_json(golden.payload()), golden.content, golden.name)


func test_json_is_written() -> void:
	for golden: Golden in _of(JSON_TYPES):
		var frame := LudusWire.json_frame(golden.type, golden.content)
		equal(frame.decode_u32(0), frame.size() - LudusWire.HEADER_BYTES, golden.name)
		equal(frame.slice(4, 8), golden.frame.slice(4, 8), golden.name)
		var written := frame.slice(LudusWire.HEADER_BYTES)
		equal(LudusWire.read_json(written), golden.content, golden.name)


func test_proofs_are_made() -> void:
	var hello: Dictionary = Golden.read(golden_folder, "hello").get("content")
	var challenge: Dictionary = Golden.read(golden_folder, "challenge").get("content")
	var ours := str(hello["nonce"]).hex_decode()
	var theirs := str(challenge["nonce"]).hex_decode()
	var proving := _all().filter(func(golden: Golden) -> bool: return not golden.token.is_empty())
	equal(proving.size(), 3, "frames that prove")
	for golden: Golden in proving:
		var role := "engine" if golden.type == LudusWire.Type.PROOF else "trainer"
		var proof := LudusGreeting.proof(golden.token, role, ours, theirs)
		equal(proof.hex_encode(), golden.content["proof"], golden.name)


func test_raw_frames_are_written() -> void:
	for golden: Golden in _of(RAW_TYPES):
		var payload: PackedByteArray = str(golden.content["payload_hex"]).hex_decode()
		equal(LudusWire.raw_frame(golden.type, payload), golden.frame, golden.name)


func test_reset_is_read() -> void:
	for golden: Golden in _of([LudusWire.Type.RESET]):
		var seeds := _seeds(golden)
		var read := LudusWire.read_reset(golden.payload(), seeds.size())
		equal(read.get("seeds"), seeds, golden.name)
		equal(read.get("actions"), PackedByteArray(golden.content["actions"]), golden.name)
		equal(read.get("parameters"), golden.content["parameters"], golden.name)


func test_reset_is_written() -> void:
	for golden: Golden in _of([LudusWire.Type.RESET]):
		var actions := PackedByteArray(golden.content["actions"])
		var parameters: Variant = golden.content["parameters"]
		var frame := LudusWire.reset_frame(_seeds(golden), actions, parameters)
		equal(frame, golden.frame, golden.name)


func test_step_is_read() -> void:
	for golden: Golden in _of([LudusWire.Type.STEP]):
		var offset := 0
		for policy: Dictionary in golden.spec["policies"]:
			var batch := _batch_of(policy)
			batch.active.fill(1)
			var end := batch.read_actions(golden.payload(), offset)
			batch.hand_out_actions()
			equal(end - offset, batch.action_bytes(), golden.name)
			offset = end
			var actions: Dictionary = golden.content["policies"][policy["name"]]
			for slot: int in batch.agents.size():
				_check_action(golden.name, batch.agents[slot] as StubAgent, actions, slot)
		equal(offset, golden.payload().size(), golden.name)


func test_batch_is_written() -> void:
	for golden: Golden in _of([LudusWire.Type.BATCH]):
		var frame := LudusWire.begin(LudusWire.Type.BATCH)
		_append_head(frame, golden.content)
		var batches: Array[LudusPolicyBatch] = []
		for policy: Dictionary in golden.spec["policies"]:
			var batch := _batch_of(policy)
			_live_through(batch, golden.content["policies"][policy["name"]])
			batch.append_to(frame)
			batches.append(batch)
		for batch: LudusPolicyBatch in batches:
			batch.append_final_to(frame)
			equal(batch.error, "", golden.name)
		equal(LudusWire.finish(frame).hex_encode(), golden.frame.hex_encode(), golden.name)


func _all() -> Array[Golden]:
	var frames: Array[Golden] = []
	for name: String in Golden.names(golden_folder):
		frames.append(Golden.read(golden_folder, name))
	return frames


func _of(types: Array) -> Array[Golden]:
	return _all().filter(func(golden: Golden) -> bool: return golden.type in types)


func _seeds(golden: Golden) -> PackedInt64Array:
	var seeds := PackedInt64Array()
	for text: String in golden.content["seeds"]:
		seeds.append((text.left(8).hex_to_int() << 32) | text.right(8).hex_to_int())
	return seeds


func _append_head(frame: PackedByteArray, content: Dictionary) -> void:
	frame.resize(LudusWire.HEADER_BYTES + LudusWire.BATCH_HEAD_BYTES)
	frame.encode_u64(8, int(content["tick"]))
	frame.encode_u32(16, int(content["engine_us"]))
	frame.encode_u32(20, int(content["bridge_us"]))
	frame.encode_u32(24, int(content["wait_us"]))
	var flags := LudusWire.FLAG_RESET if content["is_reset"] else 0
	flags |= LudusWire.FLAG_REQUESTS if content["has_requests"] else 0
	frame.encode_u32(28, flags)


## Makes a policy of stub agents from its JSON.
func _batch_of(policy: Dictionary) -> LudusPolicyBatch:
	var agents: Array[LudusAgent] = []
	var worlds := PackedInt32Array()
	for slot: Dictionary in policy["agents"]:
		agents.append(null if slot["path"] == null else _agent_of(policy))
		worlds.append(int(slot["world"]))
	return LudusPolicyBatch.new(str(policy["name"]), agents, worlds, 0)


func _agent_of(policy: Dictionary) -> StubAgent:
	var agent := StubAgent.new()
	agent.has_action_mask = policy["has_action_mask"]
	for entry: Dictionary in policy["observation"]:
		var dtype := LudusObservationEntry.DTYPE_NAMES.find(str(entry["dtype"]))
		var shape := PackedInt32Array(entry["shape"])
		agent.observation.append(LudusObservationEntry.create(str(entry["name"]), shape, dtype))
	for part: Dictionary in policy["action"]:
		if part["kind"] == "discrete":
			agent.action.append(LudusActionComponent.discrete(str(part["name"]), int(part["n"])))
		else:
			agent.action.append(
				LudusActionComponent.continuous(str(part["name"]), int(part["size"]))
			)
	add(agent)
	equal(agent.connect_to_game(), "", "a stub agent")
	return agent


## Compares what an agent was given with its row of the arrays.
func _check_action(what: String, agent: StubAgent, actions: Dictionary, slot: int) -> void:
	if agent == null:
		return
	var choices := PackedInt64Array(actions["discrete"][slot] if actions["discrete"] else [])
	var numbers := PackedFloat32Array(actions["continuous"][slot] if actions["continuous"] else [])
	var expected: Variant = numbers if choices.is_empty() else choices
	if choices.size() == 1 and numbers.is_empty():
		expected = choices[0]
	elif not choices.is_empty() and not numbers.is_empty():
		expected = _by_name(agent, choices, numbers)
	equal(agent.applied, [expected] as Array[Variant], "%s, slot %d" % [what, slot])


func _by_name(
	agent: StubAgent, choices: PackedInt64Array, numbers: PackedFloat32Array
) -> Dictionary:
	var by_name := {}
	var num_choices := 0
	var num_numbers := 0
	for part: LudusActionComponent in agent.action:
		if part.kind == LudusActionComponent.Kind.DISCRETE:
			by_name[part.name] = choices[num_choices]
			num_choices += 1
		else:
			by_name[part.name] = numbers.slice(num_numbers, num_numbers + part.size)
			num_numbers += part.size
	return by_name


## Lets a policy live through the step that the content of a frame reports.
func _live_through(batch: LudusPolicyBatch, content: Dictionary) -> void:
	var final: Dictionary = content["final"]
	for slot: int in batch.agents.size():
		var row: int = final["slots"].find(float(slot))
		batch.active[slot] = 1 if row >= 0 or float(content["reward"][slot]) != 0.0 else 0
		var agent := batch.agents[slot] as StubAgent
		if agent == null:
			continue
		agent.reward = content["reward"][slot]
		agent.is_over = content["terminated"][slot] == 1.0
		agent.is_cut = content["truncated"][slot] == 1.0
		agent.mask = PackedByteArray(content["action_mask"][slot] if agent.has_action_mask else [])
		if row >= 0:
			agent.seen = _observation_of(agent, final["observation"], row)
	batch.collect_outcomes()
	for slot: int in batch.agents.size():
		batch.active[slot] = int(content["active"][slot])
		var agent := batch.agents[slot] as StubAgent
		if agent != null:
			agent.seen = _observation_of(agent, content["observation"], slot)


## A row of every entry, as a game would return it: flat if there is one entry only.
func _observation_of(agent: StubAgent, observation: Dictionary, row: int) -> Variant:
	var by_name := {}
	for entry: LudusObservationEntry in agent.observation:
		var numbers := _flattened(observation[entry.name][row])
		match entry.dtype:
			LudusObservationEntry.DType.FLOAT32:
				by_name[entry.name] = PackedFloat32Array(numbers)
			LudusObservationEntry.DType.UINT8:
				by_name[entry.name] = PackedByteArray(numbers)
			LudusObservationEntry.DType.INT64:
				by_name[entry.name] = PackedInt64Array(numbers)
	return by_name.values()[0] if agent.observation.size() == 1 else by_name


func _flattened(value: Variant) -> Array:
	if value is not Array:
		return [value]
	var numbers := []
	for item: Variant in value:
		numbers.append_array(_flattened(item))
	return numbers
