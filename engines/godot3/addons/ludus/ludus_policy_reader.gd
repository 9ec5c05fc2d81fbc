tool
class_name LudusPolicyReader
extends Reference
## Reads a policy file (POLICY.md §1) and makes sure that its parts fit each other.

const FORMAT := "ludus-policy"
const VERSION := 1
const MAX_ITEMS := 64
const MAX_FRAMES := 256
const KIND_NAMES := ["discrete", "continuous"]

## What is wrong with the file, or an empty text.
var error: String = ""
## Name of the policy.
var policy_name: String = ""
## Hash of the spec it was trained for.
var fingerprint: String = ""
## What it looks at, in order ([LudusObservationEntry]); bounds are not read.
var entries: Array = []
## How many observations the network looks at together.
var frames: int = 1
## Components of its action in order ([LudusActionComponent]): name, kind, n, size.
var components: Array = []
## Whether choices may be forbidden.
var has_action_mask: bool = false
## Alternatives of all choices in sum.
var num_logits: int = 0
## Lowest value of every number of an action.
var low: Array = []
## Highest value of every number of an action.
var high: Array = []
## Of the joined vector; empty leaves it.
var shift: Array = []
## Of the joined vector.
var scale: Array = []
## Cut-off of the normalised vector.
var limit: float = INF
## Networks of the image entries: entry, entry_shape, convolutions, linear.
var images: Array = []
## Arrays of the memory by name; empty without one.
var memory: Dictionary = {}
## Layers: weight, bias, activation, shape.
var layers: Array = []
## Log deviations that are the same in every state; empty if the network puts them out.
var log_std: Array = []
## Whether the network puts out log deviations.
var has_own_log_std: bool = false
## Lowest and highest log deviation that the network puts out.
var log_std_range: Array = [-20.0, 2.0]
## Whether tanh keeps numbers between -1 and 1.
var is_squashed: bool = false

var _errors: Array = []


## Takes the parsed JSON.
func _init(value) -> void:
	var fields := LudusPolicyFields.new(value, "", _errors)
	if _errors.empty() and fields.raw("format") is String and fields.text("format") != FORMAT:
		fields.fail("format", 'expected "%s", got "%s"' % [FORMAT, fields.text("format")])
	elif _errors.empty() and fields.number("version") != VERSION:
		fields.fail("version", "expected %d: upgrade the add-on, or export again" % VERSION)
	for read in ["_read_spec", "_read_vector", "_read_images", "_read_actor"]:
		if _errors.empty():
			call(read, fields)
	error = _errors[0] if not _errors.empty() else ""


## Whether convolutions look at an entry.
static func is_image(entry: LudusObservationEntry) -> bool:
	return entry.dtype == LudusObservationEntry.DType.UINT8 and entry.shape.size() >= 3


## Sizes of the entries that are no images, all frames of them, in order.
func vector_sizes() -> Array:
	var sizes := []
	for entry in entries:
		if not is_image(entry):
			sizes.append(entry.size() * frames)
	return sizes


## Sizes of all parts of the features: vector entries, then images.
func feature_sizes() -> Array:
	var sizes := vector_sizes()
	for image in images:
		sizes.append(image["linear"]["bias"].size())
	return sizes


func _read_spec(fields: LudusPolicyFields) -> void:
	policy_name = fields.text("policy")
	fingerprint = fields.text("fingerprint")
	has_action_mask = fields.flag("has_action_mask")
	if fields.has("frames"):  # older files have one, and do not say so
		frames = fields.integer("frames", 1, MAX_FRAMES)
	for part in fields.parts("observation", 1, MAX_ITEMS):
		var dtype: int = part.choice("dtype", LudusObservationEntry.DTYPE_NAMES)
		var shape := PoolIntArray(part.sizes("shape", 8))
		var entry: Resource = LudusObservationEntry.create(part.text("name"), shape, dtype)
		if entry.size() < 1:
			part.fail("shape", "expected positive sizes")
		entries.append(entry)
	for part in fields.parts("action", 1, MAX_ITEMS):
		components.append(_read_component(part))
	if has_action_mask and num_logits == 0:
		fields.fail("has_action_mask", "there is no discrete action to mask")


func _read_component(fields: LudusPolicyFields) -> Resource:
	if fields.choice("kind", KIND_NAMES) == LudusActionComponent.Kind.DISCRETE:
		var n := fields.integer("n", 1, 1 << 20)
		num_logits += n
		return LudusActionComponent.discrete(fields.text("name"), n)
	var size := fields.integer("size", 1, 1 << 16)
	var lows := fields.numbers("low", size)
	var highs := fields.numbers("high", size)
	low.append_array(lows)
	high.append_array(highs)
	return LudusActionComponent.continuous(fields.text("name"), size, lows[0], highs[0])


func _read_vector(fields: LudusPolicyFields) -> void:
	if fields.is_null("normalisation"):
		return
	var size := _sum(vector_sizes())
	var part := fields.part("normalisation")
	shift = part.tensor("shift", [size])
	scale = part.tensor("scale", [size])
	limit = part.number("limit")
	if limit <= 0.0:
		part.fail("limit", "expected a positive number, got %s" % limit)


func _read_images(fields: LudusPolicyFields) -> void:
	var seen := []
	for entry in entries:
		if is_image(entry):
			seen.append(entry)
	var parts := fields.parts("images", seen.size(), seen.size())
	for i in parts.size():
		if parts[i].text("entry") != seen[i].name:
			parts[i].fail("entry", 'expected "%s"' % seen[i].name)
		else:
			images.append(_read_image(parts[i], seen[i]))


func _read_image(fields: LudusPolicyFields, entry: LudusObservationEntry) -> Dictionary:
	var shape := [frames] + Array(entry.shape)
	var height: int = shape[-3]
	var width: int = shape[-2]
	var channels := entry.size() / (height * width) * frames
	var convolutions := []
	for part in fields.parts("convolutions", 1, 16):
		var layer := _read_convolution(part, channels)
		if not _errors.empty():
			return {}
		height = (height + 2 * layer["padding"] - layer["shape"][2]) / layer["stride"] + 1
		width = (width + 2 * layer["padding"] - layer["shape"][3]) / layer["stride"] + 1
		if height < 1 or width < 1:
			part.fail("weight.shape", "the kernel is larger than the image")
		channels = layer["shape"][0]
		convolutions.append(layer)
	var linear := _read_layer(fields.part("linear"), [-1, channels * height * width])
	return {
		"entry": entry.name,
		"entry_shape": shape,
		"convolutions": convolutions,
		"linear": linear,
	}


func _read_convolution(fields: LudusPolicyFields, channels: int) -> Dictionary:
	var layer := _read_layer(fields, [-1, channels, -1, -1])
	layer["stride"] = fields.integer("stride", 1, 1 << 16)
	layer["padding"] = fields.integer("padding", 0, 1 << 16)
	if _errors.empty() and layer["padding"] >= min(layer["shape"][2], layer["shape"][3]):
		fields.fail("padding", "expected 0 to less than the kernel")
	return layer


func _read_layer(fields: LudusPolicyFields, shape: Array) -> Dictionary:
	var weight := fields.tensor("weight", shape)
	var found := fields.shape("weight")
	return {
		"weight": weight,
		"shape": found,
		"bias": fields.tensor("bias", [found[0] if not found.empty() else 0]),
		"activation": fields.choice("activation", LudusPolicyDense.ACTIVATIONS),
	}


func _read_actor(fields: LudusPolicyFields) -> void:
	var size := _sum(feature_sizes())
	if not fields.is_null("memory"):
		size = _read_memory(fields.part("memory"), size)
	_read_distribution(fields.part("distribution"))
	for part in fields.parts("layers", 1, MAX_ITEMS):
		var layer := _read_layer(part, [-1, size])
		size = layer["bias"].size()
		layers.append(layer)
	var num_outputs := num_logits + low.size() * (2 if has_own_log_std else 1)
	if _errors.empty() and size != num_outputs:
		fields.fail("layers", "expected %d outputs, got %d" % [num_outputs, size])


## Returns the size of the state.
func _read_memory(fields: LudusPolicyFields, num_inputs: int) -> int:
	var _gru := fields.choice("kind", ["gru"])
	var shape := fields.shape("weight_hidden")
	var size: int = shape[1] if shape.size() == 2 else 0
	memory = {
		"weight_hidden": fields.tensor("weight_hidden", [size * 3, size]),
		"weight_input": fields.tensor("weight_input", [size * 3, num_inputs]),
		"bias_input": fields.tensor("bias_input", [size * 3]),
		"bias_hidden": fields.tensor("bias_hidden", [size * 3]),
	}
	if size < 1:
		fields.fail("weight_hidden.shape", "expected [3 * size, size]")
	return size


func _read_distribution(fields: LudusPolicyFields) -> void:
	is_squashed = fields.flag("is_squashed")
	log_std_range = fields.numbers("log_std_range", 2)
	if log_std_range[0] > log_std_range[1]:
		fields.fail("log_std_range", "expected [lowest, highest]")
	has_own_log_std = fields.is_null("log_std")
	if not has_own_log_std:
		log_std = fields.tensor("log_std", [low.size()])


static func _sum(sizes: Array) -> int:
	var total := 0
	for size in sizes:
		total += size
	return total
