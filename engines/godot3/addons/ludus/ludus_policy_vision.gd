class_name LudusPolicyVision
extends Reference
## The network over one image entry of a policy (POLICY.md §3): convolutions, then a dense layer.

## Name of the entry.
var entry_name: String
## Number of features.
var num_features: int = 0
## Bytes of one image.
var num_bytes: int = 0

## For each element of the first convolution's input, its place in the image.
var _places: Array = []
var _convolutions: Array = []
var _dense: LudusPolicyDense


## Takes an item of [code]images[/code], with the shape of its entry,
## [code][frames…, height, width, channels][/code].
func _init(network: Dictionary) -> void:
	entry_name = network["entry"]
	var shape: Array = network["entry_shape"]
	var num_pixels: int = shape[-3] * shape[-2]
	num_bytes = 1
	for length in shape:
		num_bytes *= length
	_places = _plane_places(num_bytes / (num_pixels * shape[-1]), num_pixels, shape[-1])
	var height: int = shape[-3]
	var width: int = shape[-2]
	for layer in network["convolutions"]:
		var convolution := LudusPolicyConvolution.new(layer, height, width)
		_convolutions.append(convolution)
		height = convolution.out_height
		width = convolution.out_width
	var linear: Dictionary = network["linear"]
	num_features = linear["bias"].size()
	_dense = LudusPolicyDense.new(linear["weight"], linear["bias"], linear["activation"])


## The features of one image of [param images].
func features(images: PoolByteArray, index: int) -> Array:
	var first := index * num_bytes
	var pixels := Array(images.subarray(first, first + num_bytes - 1))
	var numbers := []
	for place in _places:
		numbers.append(pixels[place] / 255.0)
	for convolution in _convolutions:
		numbers = convolution.apply(numbers)
	var x := []
	for i in _dense.num_in:
		x.append(LudusPolicyDense.block(numbers, i * 3, numbers.size()))
	var y := []
	y.resize(_dense.num_out)
	_dense.apply(x, y, 1)
	var found := []
	for i in num_features:
		found.append(y[i / 3][i % 3])
	return found


## Channels lie together in a pixel; in the input of a convolution the frames of one channel do.
static func _plane_places(num_frames: int, num_pixels: int, num_channels: int) -> Array:
	var places := []
	for channel in num_channels:
		for frame in num_frames:
			for pixel in num_pixels:
				places.append((frame * num_pixels + pixel) * num_channels + channel)
	return places
