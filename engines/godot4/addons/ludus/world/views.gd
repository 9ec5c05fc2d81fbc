extends GridContainer
## Shows several worlds side by side, each in a view of its own.
##
## A view of a world that shares the space of the first looks as the first view does, as far away
## from there as the worlds are apart. That is for 2D only: in 3D worlds in a grid see each other.

var _followed: Dictionary[SubViewport, LudusWorld] = {}
var _first: LudusWorld
## Whether the first view is the only one, and fills the window whatever its shape.
var _is_alone: bool


func _init(num_views: int) -> void:
	name = "Views"
	_is_alone = num_views == 1
	columns = ceili(sqrt(num_views))
	set_anchors_preset(Control.PRESET_FULL_RECT)
	add_theme_constant_override(&"h_separation", 2)
	add_theme_constant_override(&"v_separation", 2)


## Adds a view that fits itself into the window. What it shows is as large as in a window of the
## project's size.
func add_view() -> SubViewport:
	var viewport := SubViewport.new()
	var container := SubViewportContainer.new()
	container.stretch = true
	container.add_child(viewport)
	var frame: Control = container if _is_alone else _frame_of_window_shape(viewport, container)
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


static func _frame_of_window_shape(viewport: SubViewport, container: Control) -> Control:
	viewport.size_2d_override = Vector2i(
		int(ProjectSettings.get_setting("display/window/size/viewport_width")),
		int(ProjectSettings.get_setting("display/window/size/viewport_height"))
	)
	viewport.size_2d_override_stretch = true
	var frame := AspectRatioContainer.new()
	frame.ratio = float(viewport.size_2d_override.x) / viewport.size_2d_override.y
	frame.add_child(container)
	return frame


func _process(_delta: float) -> void:
	if _followed.is_empty() or not is_instance_valid(_first):
		return
	var seen := _first.root.get_viewport().canvas_transform
	for viewport: SubViewport in _followed:
		var world := _followed[viewport]
		if is_instance_valid(world):
			var offset := (world.root as Node2D).position - (_first.root as Node2D).position
			viewport.canvas_transform = seen.translated_local(-offset)
