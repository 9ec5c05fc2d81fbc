extends RefCounted
## The nodes of a group that are in one world, looked up at most once a tick for all worlds.
##
## Static, as all sensors of all worlds share the look-up. It lasts for a tick, and a world forgets
## it before its first look in an episode, so no scene sees what another one has left. Nodes are not
## counted references: the list keeps none of them alive, but may name some that are gone.

static var _tick: int = -1
static var _members: Dictionary[StringName, Dictionary] = {}


## The members of [param group] in [param world], in the order of the tree.
static func of(world: LudusWorld, group: StringName) -> Array[Node]:
	var tick := Engine.get_physics_frames()
	if tick != _tick:
		_tick = tick
		_members.clear()
	if not _members.has(group):
		_members[group] = _sort(world.root.get_tree().get_nodes_in_group(group))
	var found: Array[Node] = []
	# One by one: a typed array takes nothing from a list that has a freed node in it.
	for node: Variant in _members[group].get(world, []):
		if _is_there(node):
			found.append(node)
	return found


## Forgets all, for a world that has begun an episode.
static func forget() -> void:
	_members.clear()


static func _sort(nodes: Array[Node]) -> Dictionary:
	var by_world := {}
	for node: Node in nodes:
		var world := LudusWorld.find_above(node)
		if world != null:
			var own: Array = by_world.get_or_add(world, [])
			own.append(node)
	return by_world


static func _is_there(node: Variant) -> bool:
	return (
		is_instance_valid(node)
		and (node as Node).is_inside_tree()
		and not (node as Node).is_queued_for_deletion()
	)
