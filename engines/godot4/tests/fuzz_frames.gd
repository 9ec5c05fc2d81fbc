extends SceneTree
## Reads golden frames with other bytes, as the bridge does: [code]godot --headless --path
## engines/godot4 -s tests/fuzz_frames.gd -- --golden=FOLDER --seed=N --frames=N[/code]. Prints how
## many there were and how many were allowed; a script that fails prints an error of its own.

const LudusArguments := preload("res://addons/ludus/bridge/arguments.gd")
const LudusCall := preload("res://addons/ludus/bridge/call.gd")
const LudusGreeting := preload("res://addons/ludus/bridge/greeting.gd")
const LudusSessionSetup := preload("res://addons/ludus/bridge/session_setup.gd")
const LudusLink := preload("res://addons/ludus/bridge/link.gd")
const LudusMetrics := preload("res://addons/ludus/bridge/metrics.gd")
const LudusPolicyBatch := preload("res://addons/ludus/agent/policy_batch.gd")
const LudusRequests := preload("res://addons/ludus/bridge/requests.gd")
const LudusWire := preload("res://addons/ludus/bridge/wire.gd")

const Golden := preload("golden.gd")
const TestGolden := preload("test_golden.gd")

const NUM_WORLDS := 2
const TOKEN := "a secret of the campaign"
const ODD: Array[Variant] = [
	null, true, 0, -1, 1.5, 1e300, 9223372036854775807, "", "x", [], [[]], {}, [null], {"a": {}}
]

var _chance := RandomNumberGenerator.new()
var _goldens: Array[Golden] = []
## The policies of each golden [code]STEP[/code].
var _games: Array[Array] = []
var _requests := LudusRequests.new()
var _metrics := LudusMetrics.new()
var _arguments: Dictionary = {}


func _initialize() -> void:
	# Nodes can enter the tree only when it runs.
	_run.call_deferred()
	quit.call_deferred()  # after an error in a script, too


func _run() -> void:
	for argument: String in OS.get_cmdline_user_args():
		var parts := argument.trim_prefix("--").split("=")
		_arguments[parts[0]] = parts[1]
	_chance.seed = int(str(_arguments["seed"]))
	_load_goldens(str(_arguments["golden"]))
	var num_frames := int(str(_arguments["frames"]))
	var num_read := 0
	for i: int in num_frames:
		num_read += int(_read(_mutate()))
	print("%d frames, %d read" % [num_frames, num_read])


func _load_goldens(folder: String) -> void:
	var test := TestGolden.new()
	test.tree = self
	for golden_name: String in Golden.names(folder):
		var golden: Golden = Golden.read(folder, golden_name)
		if LudusWire.max_payload_bytes(golden.type) >= 0:
			_goldens.append(golden)
		if golden.type == LudusWire.Type.STEP:
			var policies: Array[LudusPolicyBatch] = []
			for policy: Dictionary in golden.spec["policies"]:
				var batch: LudusPolicyBatch = test.call("_batch_of", policy)
				batch.active.fill(1)
				policies.append(batch)
			_games.append(policies)


func _pick(items: Array) -> Variant:
	return items[_chance.randi_range(0, items.size() - 1)]


func _mutate() -> PackedByteArray:
	var golden: Golden = _pick(_goldens)
	var frame := golden.frame.duplicate()
	var kind := _chance.randi_range(0, 3)
	if kind == 0 and frame.size() > 8 and frame[8] == 123:
		var content: Variant = _with_odd(golden.content)
		return LudusWire.raw_frame(golden.type, JSON.stringify(content).to_utf8_buffer())
	if kind == 1:
		var other: Golden = _pick(_goldens)
		var head := frame.slice(0, _chance.randi_range(0, frame.size()))
		head.append_array(other.frame.slice(_chance.randi_range(0, other.frame.size())))
		return LudusWire.raw_frame(golden.type, head.slice(8)) if head.size() > 8 else head
	var low := 0 if _chance.randf() < 0.2 or frame.size() == 8 else 8
	for i: int in _chance.randi_range(1, 4):
		var value: int = _pick([0, 1, 255, _chance.randi_range(0, 255)])
		frame[_chance.randi_range(low, frame.size() - 1)] = value
	return frame


## Returns a JSON value with an odd one somewhere inside.
func _with_odd(value: Variant) -> Variant:
	if value is Dictionary and not (value as Dictionary).is_empty() and _chance.randf() > 0.1:
		var changed: Dictionary = (value as Dictionary).duplicate()
		var key: Variant = _pick(changed.keys())
		changed[key] = _with_odd(changed[key])
		return changed
	if value is Array and not (value as Array).is_empty() and _chance.randf() > 0.1:
		var items: Array = (value as Array).duplicate()
		var at := _chance.randi_range(0, items.size() - 1)
		items[at] = _with_odd(items[at])
		return items
	return _pick(ODD)


## Reads a frame from a stream, as the bridge does. Returns whether it is allowed.
func _read(frame: PackedByteArray) -> bool:
	var link := _link_with(frame)
	if not link.receive():
		return false
	var is_read := true
	match link.type:
		LudusWire.Type.WELCOME:
			is_read = _greet(frame)
		LudusWire.Type.CHALLENGE:
			is_read = _prove(frame)
		LudusWire.Type.RESET:
			is_read = not LudusWire.read_reset(link.payload, NUM_WORLDS).is_empty()
		LudusWire.Type.STEP:
			is_read = _apply(link.payload)
		LudusWire.Type.CALL:
			var answer := LudusCall.new(link.payload)
			if answer.is_for_bridge() and not answer.is_stand_by() and not answer.is_ceiling():
				is_read = not answer.answer_for_bridge(_requests, _metrics).is_empty()
		LudusWire.Type.ERROR:
			is_read = LudusWire.read_json(link.payload) != null
	return is_read


## A connection on which no more than [param frame] will ever come.
func _link_with(frame: PackedByteArray) -> LudusLink:
	var stream := StreamPeerBuffer.new()
	stream.data_array = frame
	var link := LudusLink.new()
	link.set("_stream", stream)
	link.set("_watch", Thread.new())  # without one, the link would wait for the rest of a frame
	return link


func _greet(frame: PackedByteArray) -> bool:
	var link := _link_with(frame)
	link.is_proven = true
	return LudusSessionSetup.new(link, LudusArguments.new()).take_settings({})


## Whoever does not know the nonce cannot prove anything, so that no challenge is allowed.
func _prove(frame: PackedByteArray) -> bool:
	var greeting := LudusGreeting.new(StreamPeerBuffer.new(), {}, TOKEN, 1000)
	greeting.set("_received", frame)
	greeting.call("_read_frame")
	return greeting.state == LudusGreeting.State.PROVEN


func _apply(payload: PackedByteArray) -> bool:
	var is_read := false
	for policies: Array in _games:
		var num_bytes := 0
		for batch: LudusPolicyBatch in policies:
			num_bytes += batch.action_bytes()
		if num_bytes != payload.size():
			continue
		is_read = true
		var offset := 0
		for batch: LudusPolicyBatch in policies:
			offset = batch.read_actions(payload, offset)
			batch.hand_out_actions()
			batch.error = ""
			for agent: LudusAgent in batch.agents:
				if agent != null:
					agent.set("applied", [] as Array[Variant])
	return is_read
