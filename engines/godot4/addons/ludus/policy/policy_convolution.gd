extends RefCounted
## One convolution of a policy (POLICY.md §3): a dense layer over the patches of an image.
##
## An image is planes of [code][height, width, channels][/code] floats, one after the other; the
## channels of a plane are padded to whole blocks by the convolution before. A patch is gathered by
## copying whole lines of it, which the engine does.

const LudusPolicyDense := preload("res://addons/ludus/policy/policy_dense.gd")

## Size of what comes out.
var out_height: int = 0
## Size of what comes out.
var out_width: int = 0
## Channels of what comes out, padded to whole blocks.
var out_channels: int = 0

var _dense: LudusPolicyDense
var _num_planes: int
var _height: int
var _width: int
var _channels: int
var _kernel_height: int
var _kernel_width: int
var _stride: int
var _padding: int
## Unused bytes at the end of a patch.
var _rest: PackedByteArray = []
var _y: PackedVector4Array = []


## Takes a layer of [LudusPolicyReader] and the size of the input. [param channels] is padded;
## [param places] tells for each plane and channel the channel of the weights, or -1.
func _init(
	layer: Dictionary,
	num_planes: int,
	height: int,
	width: int,
	channels: int,
	places: PackedInt32Array
) -> void:
	var shape: PackedInt32Array = layer["shape"]
	_num_planes = num_planes
	_stride = layer["stride"]
	_padding = layer["padding"]
	_height = height + 2 * _padding
	_width = width + 2 * _padding
	_channels = channels
	_kernel_height = shape[2]
	_kernel_width = shape[3]
	out_height = (_height - _kernel_height) / _stride + 1
	out_width = (_width - _kernel_width) / _stride + 1
	var rows := LudusPolicyDense.spread([shape[0]])
	out_channels = rows.size()
	var columns := _columns(shape, places)
	_dense = LudusPolicyDense.new(
		layer["weight"], layer["bias"], rows, columns, layer["activation"]
	)
	_y.resize(out_height * out_width * _dense.num_out)


## Returns the image after the convolution, as the bytes of its floats.
func apply(image: PackedByteArray) -> PackedByteArray:
	var padded := image if _padding == 0 else _pad(image)
	_dense.apply(_patches(padded), _y, out_height * out_width)
	return _y.to_byte_array()


## The place of every number of a patch in one filter of the weights.
func _columns(shape: PackedInt32Array, places: PackedInt32Array) -> PackedInt32Array:
	var columns := PackedInt32Array()
	for plane: int in _num_planes:
		for y: int in _kernel_height:
			for x: int in _kernel_width:
				for channel: int in _channels:
					var place := places[plane * _channels + channel]
					var index := (place * shape[2] + y) * shape[3] + x
					columns.append(index if place >= 0 else -1)
	while columns.size() % 4 != 0:
		columns.append(-1)
		_rest.resize(_rest.size() + 4)
	return columns


func _patches(image: PackedByteArray) -> PackedVector4Array:
	var patches := PackedByteArray()
	var pixel := _channels * 4
	var line := _width * pixel
	var run := _kernel_width * pixel
	for y: int in out_height:
		for x: int in out_width:
			for plane: int in _num_planes:
				var from := (plane * _height + y * _stride) * line + x * _stride * pixel
				for i: int in _kernel_height:
					patches.append_array(image.slice(from, from + run))
					from += line
			if not _rest.is_empty():
				patches.append_array(_rest)
	return LudusPolicyDense.vectors(patches)


## Puts zeros around every plane.
func _pad(image: PackedByteArray) -> PackedByteArray:
	var pixel := _channels * 4
	var run := (_width - 2 * _padding) * pixel
	var side := PackedByteArray()
	side.resize(_padding * pixel)
	var lines := PackedByteArray()
	lines.resize(_padding * _width * pixel)
	var padded := PackedByteArray()
	var from := 0
	for plane: int in _num_planes:
		padded.append_array(lines)
		for y: int in _height - 2 * _padding:
			padded.append_array(side)
			padded.append_array(image.slice(from, from + run))
			padded.append_array(side)
			from += run
		padded.append_array(lines)
	return padded
