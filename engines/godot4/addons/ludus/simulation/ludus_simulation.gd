# gdlint: disable=max-public-methods
class_name LudusSimulation
extends RefCounted
## A game in code, without nodes: several agents by index, each with a policy name.
##
## Extend it, and put a [LudusSimulationHost] with that script as the root of a scene. Then the
## scene is a world like any other: it is trained, measured, checked and played.[br][br]
## What happens: [method create] once, [method begin_episode] at every beginning; then in every
## physics tick [method apply_action] of all agents that act, and [method advance] once; after
## [method ticks_per_step] ticks [method get_reward], [method is_done] and
## [method get_observation].

## Emitted when a whole physics tick has passed; while an episode runs, just before
## [method advance]. [method create] and [method begin_episode] may await it.
@warning_ignore("unused_signal")
signal ticked

const LudusSimulationSpaces := preload("res://addons/ludus/simulation/simulation_spaces.gd")

## The world: its random stream is [member LudusWorld.rng], its parameters
## [member LudusWorld.parameters]. Set before [method create].
var world: LudusWorld
## Where the simulation lies in [method space_2d]: zero where the space is its own. All places that
## are handed to physics need it added.
var offset_2d: Vector2
## Where the simulation lies in [method space_3d]: zero where the space is its own.
var offset_3d: Vector3

var _spaces: LudusSimulationSpaces


## The 2D physics space, made on first use; freed after [method clean_up].
func space_2d() -> RID:
	return _spaces.space_2d()


## The 3D physics space, made on first use; freed after [method clean_up].
func space_3d() -> RID:
	return _spaces.space_3d()


## Hands over something that [PhysicsServer2D] made, to be freed after [method clean_up], the
## newest first. Returns it.
func own_2d(rid: RID) -> RID:
	_spaces.owned_2d.append(rid)
	return rid


## Hands over something that [PhysicsServer3D] made, to be freed after [method clean_up], the
## newest first. Returns it.
func own_3d(rid: RID) -> RID:
	_spaces.owned_3d.append(rid)
	return rid


## The policy of each agent, by index. To be overridden; always the same.
func policy_names() -> PackedStringArray:
	return []


## What the agents of a policy see. To be overridden; always the same, and not empty.
func observation_entries(_policy_name: String) -> Array[LudusObservationEntry]:
	return []


## What the agents of a policy decide. To be overridden; always the same, and not empty.
func action_components(_policy_name: String) -> Array[LudusActionComponent]:
	return []


## Training settings of a policy; null: the trainer's choice.
func settings(_policy_name: String) -> LudusPolicySettings:
	return null


## Whether [method get_action_mask] is asked for the agents of a policy.
func has_action_mask(_policy_name: String) -> bool:
	return false


## Physics ticks per decision.
func ticks_per_step() -> int:
	return 1


## Steps after which an episode is cut off (truncated); 0: never.
func max_episode_steps() -> int:
	return 0


## Ticks that [method create] and [method begin_episode] may take together.
func max_begin_ticks() -> int:
	return 600


## Makes the game, once, before the first episode. May be a coroutine that awaits [signal ticked].
func create() -> void:
	pass


## Begins an episode of all agents. May be a coroutine that awaits [signal ticked]: the world is
## not observed before it is over.
func begin_episode() -> void:
	pass


## Begins the next episode of one agent while the others play on. Only in a world with several
## agents whose episodes end one by one ([constant LudusWorld.AGENT]); no coroutine.
func begin_agent_episode(_agent: int) -> void:
	push_error(
		(
			(
				"ludus: %s: begin_agent_episode() is not overridden: either do so, or set "
				+ "episode_mode of the LudusSimulationHost to World"
			)
			% describe()
		)
	)


## Takes an agent's decision, in every tick of the step: an [int], a [PackedInt64Array], a
## [PackedFloat32Array] or a dictionary, as described at [LudusAgent].
func apply_action(_agent: int, _action: Variant) -> void:
	pass


## Moves the game on by one physics tick, after the actions of all agents were applied.
func advance() -> void:
	pass


## What an agent sees: a [PackedFloat32Array], or a dictionary of entry name to array.
func get_observation(_agent: int) -> Variant:
	return PackedFloat32Array()


## An agent's reward since the last call.
func get_reward(_agent: int) -> float:
	return 0.0


## Whether an agent's episode has ended.
func is_done(_agent: int) -> bool:
	return false


## Whether an agent's episode is cut off now. Asked only where it is overridden.
func is_truncated(_agent: int) -> bool:
	return false


## What an agent may choose, one byte per alternative, 1 = allowed.
func get_action_mask(_agent: int) -> PackedByteArray:
	return []


## What a person wants an agent to do while no trainer is there; null: nobody plays it.
func get_manual_action(_agent: int) -> Variant:
	return null


## Frees what was made by calls of the physics servers and not handed to [method own_2d] or
## [method own_3d].
func clean_up() -> void:
	pass


## Whether a method of this class is overridden. A script's list of methods has an inherited method
## once, and once more for every script that overrides it.
func overrides(method: StringName) -> bool:
	var count := 0
	for described: Dictionary in (get_script() as Script).get_script_method_list():
		count += int(described["name"] == method)
	return count > 1


## Path of the simulation's script, for messages.
func describe() -> String:
	var script: Script = get_script()
	return script.resource_path if not script.resource_path.is_empty() else "a LudusSimulation"
