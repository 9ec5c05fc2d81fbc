@tool
extends EditorInspectorPlugin
## Shows above the properties of a [LudusAgent] what it observes and decides, sensors included, and
## why something does not fit.


func _can_handle(object: Object) -> bool:
	return object is LudusAgent


func _parse_begin(object: Object) -> void:
	add_custom_control(LudusSummary.new(object as LudusAgent))


## The text of one agent. It follows the agent, its sensors and its scripts by looking again.
class LudusSummary:
	extends Label

	const PERIOD_S := 0.5

	var _agent: LudusAgent
	var _left_s: float = 0.0

	func _init(agent: LudusAgent) -> void:
		_agent = agent
		name = "LudusSpaces"
		autowrap_mode = TextServer.AUTOWRAP_WORD_SMART
		text = describe(agent)

	func _process(delta: float) -> void:
		_left_s -= delta
		if _left_s <= 0.0 and is_instance_valid(_agent) and _agent.is_inside_tree():
			_left_s = PERIOD_S
			text = describe(_agent)

	## What an agent observes and decides, and what is wrong with it.
	static func describe(agent: LudusAgent) -> String:
		var lines := PackedStringArray(["Observation"])
		for entry: LudusObservationEntry in agent.known_entries():
			if entry != null:
				lines.append("    " + entry.describe())
		if agent.observation.is_empty() and agent.game_observes():
			lines.append("    what get_observation() returns first, float32 without bounds")
		lines.append("Action")
		for part: LudusActionComponent in agent.action:
			if part != null:
				lines.append("    " + part.describe())
		if agent.has_mask():
			lines.append("    masked by get_action_mask()")
		for warning: String in agent._get_configuration_warnings():
			lines.append("⚠ " + warning)
		return "\n".join(lines)
