extends RefCounted
## The network over one image entry of a policy (POLICY.md §3): convolutions, then a dense layer.

const LudusPolicyConvolution := preload("res://addons/ludus/policy/policy_convolution.gd")
const LudusPolicyDense := preload("res://addons/ludus/policy/policy_dense.gd")

## Name of the entry.
var entry_name: String
## Number of features.
var num_features: int = 0
## Bytes of one image.
var num_bytes: int = 0

var _bytes_per_line: int
var _num_lines: int
var _convolutions: Array[LudusPolicyConvolution] = []
var _dense: LudusPolicyDense
var _features: PackedVector4Array = []


## Takes an item of [code]images[/code] and the shape of its entry,
## [code][frames…, height, width, channels][/code].
func _init(network: Dictionary, shape: PackedInt32Array) -> void:
	entry_name = network["entry"]
	num_bytes = 1
	for length: int in shape:
		num_bytes *= length
	var channels := shape[-1]
	var height := shape[-3]
	var width := shape[-2]
	_bytes_per_line = width * channels
	_num_lines = num_bytes / _bytes_per_line
	var num_frames := _num_lines / height
	var places := _frame_places(num_frames, channels)
	for layer: Dictionary in network["convolutions"]:
		var convolution := LudusPolicyConvolution.new(
			layer, num_frames, height, width, channels, places
		)
		_convolutions.append(convolution)
		height = convolution.out_height
		width = convolution.out_width
		channels = convolution.out_channels
		num_frames = 1
		places = LudusPolicyDense.spread([(layer["shape"] as PackedInt32Array)[0]])
	_add_dense(network["linear"], height * width, places)


## Writes the features of one image of [param images] to a row of [param x], from [param target] on.
func apply(images: PackedByteArray, index: int, x: PackedVector4Array, target: int) -> void:
	var pixels := images.slice(index * num_bytes, (index + 1) * num_bytes)
	# The engine divides bytes by 255 when it turns them into floats.
	var image := Image.create_from_data(_bytes_per_line, _num_lines, false, Image.FORMAT_R8, pixels)
	image.convert(Image.FORMAT_RF)
	var bytes := image.get_data()
	for convolution: LudusPolicyConvolution in _convolutions:
		bytes = convolution.apply(bytes)
	_dense.apply(LudusPolicyDense.vectors(bytes), _features, 1)
	for i: int in _features.size():
		x[target + i] = _features[i]


## Frames are planes of the first convolution, but lie together for each channel in its weights.
static func _frame_places(num_frames: int, num_channels: int) -> PackedInt32Array:
	var places := PackedInt32Array()
	for frame: int in num_frames:
		for channel: int in num_channels:
			places.append(channel * num_frames + frame)
	return places


## The dense layer's weights go channel by channel, an image pixel by pixel.
func _add_dense(layer: Dictionary, num_pixels: int, places: PackedInt32Array) -> void:
	var columns := PackedInt32Array()
	for pixel: int in num_pixels:
		for place: int in places:
			columns.append(place * num_pixels + pixel if place >= 0 else -1)
	num_features = (layer["bias"] as PackedFloat32Array).size()
	var rows := LudusPolicyDense.spread([num_features])
	_dense = LudusPolicyDense.new(
		layer["weight"], layer["bias"], rows, columns, layer["activation"]
	)
	_features.resize(_dense.num_out)
