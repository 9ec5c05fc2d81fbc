class_name LudusPolicyConvolution
extends Reference
## A convolution of a policy (POLICY.md §3): a dense layer over the patch that each pixel sees.

## Height of what is put out.
var out_height: int = 0
## Width of what is put out.
var out_width: int = 0
## Planes of what is put out.
var out_channels: int = 0

var _height: int
var _width: int
var _stride: int
var _padding: int
## Channels, height and width of the kernel.
var _kernel: Array
var _dense: LudusPolicyDense
## For each pixel that is put out, and each number of its patch, its place in the input; the place
## after the last one holds the zero of the padding.
var _places: Array = []
var _patches: Array = []
var _pixels: Array = []


## Takes an item of [code]convolutions[/code] and the size of its input.
func _init(layer: Dictionary, height: int, width: int) -> void:
	var shape: Array = layer["shape"]
	_height = height
	_width = width
	_stride = layer["stride"]
	_padding = layer["padding"]
	_kernel = shape.slice(1, 3)
	out_channels = shape[0]
	out_height = (height + 2 * _padding - shape[2]) / _stride + 1
	out_width = (width + 2 * _padding - shape[3]) / _stride + 1
	_dense = LudusPolicyDense.new(layer["weight"], layer["bias"], layer["activation"])
	for i in out_height:
		for j in out_width:
			_places.append(_patch_places(i * _stride - _padding, j * _stride - _padding))
	_patches.resize(_places.size() * _dense.num_in)
	_pixels.resize(_places.size() * _dense.num_out)


## Returns [code][channels, height, width][/code], flat, for such an input.
func apply(numbers: Array) -> Array:
	numbers.append(0.0)
	var target := 0
	for places in _places:
		var patch := []
		for place in places:
			patch.append(numbers[place])
		for i in _dense.num_in:
			_patches[target] = LudusPolicyDense.block(patch, i * 3, patch.size())
			target += 1
	_dense.apply(_patches, _pixels, _places.size())
	var planes := []
	for channel in out_channels:
		for pixel in _places.size():
			planes.append(_pixels[pixel * _dense.num_out + channel / 3][channel % 3])
	return planes


## The places of the patch whose upper left corner is at [param top] and [param left].
func _patch_places(top: int, left: int) -> Array:
	var places := []
	var zero: int = _kernel[0] * _height * _width
	for channel in _kernel[0]:
		for i in range(top, top + _kernel[1]):
			for j in range(left, left + _kernel[2]):
				var is_inside := i >= 0 and i < _height and j >= 0 and j < _width
				places.append((channel * _height + i) * _width + j if is_inside else zero)
	return places
