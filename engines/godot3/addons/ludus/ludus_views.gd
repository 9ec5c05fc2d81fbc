class_name LudusViews
extends GridContainer
## Shows several worlds side by side, each in a view of its own.
##
## A view of a world that shares the space of the first looks as the first view does, as far away
## from there as the worlds are apart. That is for 2D only: in 3D worlds in a grid see each other.

## The world that a [Viewport] looks at.
var _followed: Dictionary = {}
var _first: LudusWorld
## Whether the first view is the only one, and fills the window whatever its shape.
var _is_alone: bool


func _init(num_views: int) -> void:
	name = "Views"
	_is_alone = num_views == 1
	columns = int(ceil(sqrt(num_views)))
	set_anchors_preset(Control.PRESET_WIDE)
	add_constant_override("hseparation", 2)
	add_constant_override("vseparation", 2)


## Adds a view that fits itself into the window. What it shows is as large as in a window of the
## project's size.
func add_view() -> Viewport:
	var viewport := Viewport.new()
	var container := ViewportContainer.new()
	container.stretch = true
	container.add_child(viewport)
	var frame: Control = container
	if not _is_alone:
		frame = _frame_of_window_shape(viewport, container)
	frame.size_flags_horizontal = Control.SIZE_EXPAND_FILL
	frame.size_flags_vertical = Control.SIZE_EXPAND_FILL
	add_child(frame)
	return viewport


## Lets a view look at [param world], which lies in the space of another view.
func look_at_world(world: LudusWorld, first: LudusWorld) -> void:
	var viewport := add_view()
	_first = first
	viewport.world_2d = first.root.get_viewport().world_2d
	_followed[viewport] = world


static func _frame_of_window_shape(viewport: Viewport, container: ViewportContainer) -> Control:
	var size := Vector2(
		ProjectSettings.get_setting("display/window/size/width"),
		ProjectSettings.get_setting("display/window/size/height")
	)
	viewport.set_size_override(true, size)
	viewport.set_size_override_stretch(true)
	var frame := AspectRatioContainer.new()
	frame.ratio = size.x / size.y
	frame.add_child(container)
	return frame


func _process(_delta: float) -> void:
	if _followed.empty() or not is_instance_valid(_first):
		return
	var seen: Transform2D = _first.root.get_viewport().canvas_transform
	for viewport in _followed:
		var world: LudusWorld = _followed[viewport]
		if is_instance_valid(world):
			var offset: Vector2 = world.root.position - _first.root.position
			viewport.canvas_transform = seen * Transform2D(0.0, -offset)
