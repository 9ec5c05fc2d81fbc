@tool
extends RefCounted
## Gives the agents of the scene that is edited the policies that were exported, to be undone.


## Gives each agent the policy of its name from [param folder], as far as it fits. Returns what was
## done, a line each.
static func assign(folder: String, undo_redo: EditorUndoRedoManager) -> PackedStringArray:
	var root := EditorInterface.get_edited_scene_root()
	if root == null:
		return ["no scene is open that could take the policies"]
	var lines := PackedStringArray()
	var policies: Dictionary[String, LudusPolicy] = {}
	for agent: LudusAgent in _agents_below(root, root):
		var path := folder.path_join(agent.policy_name + ".ludus.json")
		if not FileAccess.file_exists(path):
			continue
		if not policies.has(agent.policy_name):
			policies[agent.policy_name] = _load(path)
		var policy := policies[agent.policy_name]
		var problem := policy.incompatibility(agent)
		if not problem.is_empty():
			lines.append("error: agent %s: %s" % [root.get_path_to(agent), problem])
			continue
		undo_redo.create_action("Give %s its trained policy" % agent.name)
		undo_redo.add_do_property(agent, &"policy", policy)
		undo_redo.add_undo_property(agent, &"policy", agent.policy)
		undo_redo.commit_action()
		lines.append("agent %s plays %s now" % [root.get_path_to(agent), path])
	if lines.is_empty():
		var scene := root.scene_file_path
		lines.append("error: %s has no agent whose policy is in %s" % [scene, folder])
	return lines


static func _load(path: String) -> LudusPolicy:
	var policy := LudusPolicy.new()
	policy.model = ResourceLoader.load(path, "JSON", ResourceLoader.CACHE_MODE_REPLACE) as JSON
	return policy


## The agents of the scene itself: those of instances belong to other scenes.
static func _agents_below(node: Node, root: Node) -> Array[LudusAgent]:
	var found: Array[LudusAgent] = []
	if node is LudusAgent and (node == root or node.owner == root):
		found.append(node as LudusAgent)
	for child: Node in node.get_children():
		found.append_array(_agents_below(child, root))
	return found
