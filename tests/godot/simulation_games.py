"""Scripts of small simulations (LudusSimulation): right ones, and some that go wrong."""

from __future__ import annotations

from pathlib import Path

from ludus.addon import install_addon

__all__ = ["write_project"]

PROJECT = """\
config_version=5

[application]

config/name="Simulations"
run/main_scene="res://rounds.tscn"

[debug]

file_logging/enable_file_logging=false
file_logging/enable_file_logging.pc=false

[physics]

3d/physics_engine="Jolt Physics"
"""

SCENE = """\
[gd_scene format=3]
[ext_resource type="Script" path="res://addons/ludus/simulation/ludus_simulation_host.gd" id="1"]
{script}
[node name="Game" type="Node2D"]
script = ExtResource("1")
{properties}
"""
SCRIPT = '[ext_resource type="Script" path="res://{name}.gd" id="2"]'

# Two runners and a watcher. Runner 0 ends after 2 steps, runner 1 after 3, the round after 5.
ROUNDS = """\
extends LudusSimulation
var ticks := 0
var episodes := 0
var created := 0
var draw := 0.0
var last: Array[int] = [-1, -1, -1]
var sums: Array[int] = [0, 0, 0]
func policy_names() -> PackedStringArray:
	return ["runner", "runner", "watcher"]
func observation_entries(_policy: String) -> Array[LudusObservationEntry]:
	return [LudusObservationEntry.create("observation", [6])]
func action_components(_policy: String) -> Array[LudusActionComponent]:
	return [LudusActionComponent.discrete("move", 3)]
func settings(policy: String) -> LudusPolicySettings:
	var own := LudusPolicySettings.new()
	own.learning_rate = 0.01
	return own if policy == "watcher" else null
func ticks_per_step() -> int:
	return 2
func max_episode_steps() -> int:
	return 5
func create() -> void:
	created += 1
	world.callable_methods = ["count_episodes"]
	world.rng.randf()
func begin_episode() -> void:
	ticks = 0
	episodes += 1
	draw = world.rng.randf()
	last = [-1, -1, -1]
	sums = [0, 0, 0]
func apply_action(agent: int, action: Variant) -> void:
	last[agent] = action
	sums[agent] += action
func advance() -> void:
	ticks += 1
func get_observation(agent: int) -> Variant:
	return PackedFloat32Array([agent, ticks, sums[agent], draw, episodes, created])
func get_reward(agent: int) -> float:
	return agent + last[agent]
func is_done(agent: int) -> bool:
	return (agent == 0 and ticks >= 4) or (agent == 1 and ticks >= 6)
func has_action_mask(policy: String) -> bool:
	return policy == "watcher"
func get_action_mask(_agent: int) -> PackedByteArray:
	return [1, int(ticks % 4 == 0), 1]
func count_episodes(factor: int) -> int:
	return episodes * factor
"""

# A 2D ball and a 3D box that fall, each in its space; both are there only when 3 ticks have passed.
FALL = """\
extends LudusSimulation
var ball: RID
var box: RID
var ticks_to_create := 0
func policy_names() -> PackedStringArray:
	return ["ball"]
func observation_entries(_policy: String) -> Array[LudusObservationEntry]:
	return [LudusObservationEntry.create("observation", [7])]
func action_components(_policy: String) -> Array[LudusActionComponent]:
	return [LudusActionComponent.continuous("push", 2)]
func ticks_per_step() -> int:
	return 2
func max_episode_steps() -> int:
	return 20
func create() -> void:
	var disc := own_2d(PhysicsServer2D.circle_shape_create())
	PhysicsServer2D.shape_set_data(disc, 10.0)
	ball = own_2d(PhysicsServer2D.body_create())
	PhysicsServer2D.body_add_shape(ball, disc)
	PhysicsServer2D.body_set_space(ball, space_2d())
	var slab := own_2d(PhysicsServer2D.rectangle_shape_create())
	PhysicsServer2D.shape_set_data(slab, Vector2(500, 10))
	var ground := own_2d(PhysicsServer2D.body_create())
	PhysicsServer2D.body_set_mode(ground, PhysicsServer2D.BODY_MODE_STATIC)
	PhysicsServer2D.body_add_shape(ground, slab)
	PhysicsServer2D.body_set_space(ground, space_2d())
	var below := Transform2D(0.0, offset_2d + Vector2(0, 60))
	PhysicsServer2D.body_set_state(ground, PhysicsServer2D.BODY_STATE_TRANSFORM, below)
	var cube := own_3d(PhysicsServer3D.box_shape_create())
	PhysicsServer3D.shape_set_data(cube, Vector3.ONE)
	box = own_3d(PhysicsServer3D.body_create())
	PhysicsServer3D.body_add_shape(box, cube)
	PhysicsServer3D.body_set_space(box, space_3d())
	for i: int in 3:
		await ticked
		ticks_to_create += 1
func begin_episode() -> void:
	var start := offset_2d + Vector2(world.rng.randf_range(-50, 50), 0)
	PhysicsServer2D.body_set_state(
		ball, PhysicsServer2D.BODY_STATE_TRANSFORM, Transform2D(0.0, start))
	PhysicsServer2D.body_set_state(ball, PhysicsServer2D.BODY_STATE_LINEAR_VELOCITY, Vector2.ZERO)
	PhysicsServer2D.body_set_state(ball, PhysicsServer2D.BODY_STATE_ANGULAR_VELOCITY, 0.0)
	PhysicsServer3D.body_set_state(
		box, PhysicsServer3D.BODY_STATE_TRANSFORM, Transform3D(Basis(), offset_3d))
	PhysicsServer3D.body_set_state(box, PhysicsServer3D.BODY_STATE_LINEAR_VELOCITY, Vector3.ZERO)
func apply_action(_agent: int, action: Variant) -> void:
	PhysicsServer2D.body_apply_central_impulse(ball, Vector2(action[0], action[1]) * 10.0)
func get_observation(_agent: int) -> Variant:
	var state := PhysicsServer2D.body_get_direct_state(ball)
	var at := state.transform.origin - offset_2d
	var speed := state.linear_velocity
	var high := PhysicsServer3D.body_get_direct_state(box).transform.origin.y - offset_3d.y
	return PackedFloat32Array([at.x, at.y, speed.x, speed.y, high, ticks_to_create, find_ball()])
func find_ball() -> int:
	var query := PhysicsPointQueryParameters2D.new()
	query.position = PhysicsServer2D.body_get_direct_state(ball).transform.origin
	var hits := PhysicsServer2D.space_get_direct_state(space_2d()).intersect_point(query)
	return hits.filter(func(hit: Dictionary) -> bool: return hit["rid"] == ball).size()
func get_reward(_agent: int) -> float:
	return 1.0
"""

# Dictionaries both ways; each agent's episode ends by itself: agent 0 is done, agent 1 cut off.
MIXED = """\
extends LudusSimulation
var steps: Array[int] = [0, 0]
var begun: Array[int] = [0, 0]
var aims: Array[PackedFloat32Array] = [[0, 0], [0, 0]]
var moves: Array[int] = [0, 0]
func policy_names() -> PackedStringArray:
	return ["one", "other"]
func observation_entries(_policy: String) -> Array[LudusObservationEntry]:
	return [
		LudusObservationEntry.create("aim", [2]),
		LudusObservationEntry.create("counts", [3], LudusObservationEntry.DType.INT64)]
func action_components(_policy: String) -> Array[LudusActionComponent]:
	return [LudusActionComponent.continuous("aim", 2), LudusActionComponent.discrete("move", 4)]
func begin_episode() -> void:
	for agent: int in 2:
		begin_agent_episode(agent)
func begin_agent_episode(agent: int) -> void:
	steps[agent] = 0
	begun[agent] += 1
func apply_action(agent: int, action: Variant) -> void:
	aims[agent] = action["aim"]
	moves[agent] = action["move"]
func advance() -> void:
	for agent: int in 2:
		steps[agent] += 1
func get_observation(agent: int) -> Variant:
	return {"counts": [steps[agent], begun[agent], moves[agent]], "aim": aims[agent]}
func is_done(agent: int) -> bool:
	return agent == 0 and steps[agent] == 2
func is_truncated(agent: int) -> bool:
	return agent == 1 and steps[agent] == 3
"""

# The observation says which of 3 moves is right; a round is 10 moves.
CHOICE = """\
extends LudusSimulation
var wanted: Array[int] = [0, 0]
var chosen: Array[int] = [0, 0]
var rewards: Array[float] = [0.0, 0.0]
func policy_names() -> PackedStringArray:
	return ["chooser", "chooser"]
func observation_entries(_policy: String) -> Array[LudusObservationEntry]:
	var entry := LudusObservationEntry.create("wanted", [3])
	entry.low = 0.0
	entry.high = 1.0
	return [entry]
func action_components(_policy: String) -> Array[LudusActionComponent]:
	return [LudusActionComponent.discrete("choice", 3)]
func max_episode_steps() -> int:
	return 10
func begin_episode() -> void:
	for agent: int in 2:
		wanted[agent] = world.rng.randi_range(0, 2)
func apply_action(agent: int, action: Variant) -> void:
	chosen[agent] = action
func advance() -> void:
	for agent: int in 2:
		rewards[agent] = float(chosen[agent] == wanted[agent])
		wanted[agent] = world.rng.randi_range(0, 2)
func get_observation(agent: int) -> Variant:
	var seen := PackedFloat32Array([0, 0, 0])
	seen[wanted[agent]] = 1.0
	return seen
func get_reward(agent: int) -> float:
	return rewards[agent]
"""

ENDLESS = """\
extends "res://fall.gd"
func max_begin_ticks() -> int:
	return 7
func begin_episode() -> void:
	while true:
		await ticked
"""

# The number of ticks that an episode takes to begin depends on world and episode.
SLOW = """\
extends "res://fall.gd"
var num_begun := 0
func begin_episode() -> void:
	num_begun += 1
	for i: int in num_begun + 2 * world.index:
		await ticked
	super()
func max_episode_steps() -> int:
	return 0
func is_done(_agent: int) -> bool:
	return world.index == 1 and find_ball() == 1 and num_begun < 3
"""

# Leaves bodies, an area, and the shapes that they have; the area has one twice.
LEAKY = """\
extends "res://rounds.gd"
func create() -> void:
	var shape := PhysicsServer2D.circle_shape_create()
	PhysicsServer2D.shape_set_data(shape, 10.0)
	var body := PhysicsServer2D.body_create()
	PhysicsServer2D.body_add_shape(body, shape)
	PhysicsServer2D.body_set_space(body, space_2d())
	var area := PhysicsServer2D.area_create()
	PhysicsServer2D.area_add_shape(area, shape)
	PhysicsServer2D.area_add_shape(area, shape)
	PhysicsServer2D.area_set_space(area, space_2d())
	var place := Transform2D(0.0, offset_2d)
	PhysicsServer2D.area_set_transform(area, place)
	PhysicsServer2D.body_set_state(body, PhysicsServer2D.BODY_STATE_TRANSFORM, place)
	var sphere := PhysicsServer3D.sphere_shape_create()
	PhysicsServer3D.shape_set_data(sphere, 1.0)
	var rock := PhysicsServer3D.body_create()
	PhysicsServer3D.body_add_shape(rock, sphere)
	PhysicsServer3D.body_set_state(
		rock, PhysicsServer3D.BODY_STATE_TRANSFORM, Transform3D(Basis(), offset_3d))
	PhysicsServer3D.body_set_space(rock, space_3d())
"""

CLEAN = (
    LEAKY.replace("var shape :=", "shape =")
    .replace("var body :=", "body =")
    .replace("var area :=", "area =")
    .replace("var sphere :=", "sphere =")
    .replace("var rock :=", "rock =")
    .replace(
        "func create() -> void:\n",
        "var shape: RID\nvar body: RID\nvar area: RID\nvar sphere: RID\nvar rock: RID\n"
        "func clean_up() -> void:\n"
        "\tfor rid: RID in [body, area, shape]:\n\t\tPhysicsServer2D.free_rid(rid)\n"
        "\tfor rid: RID in [rock, sphere]:\n\t\tPhysicsServer3D.free_rid(rid)\n"
        "func create() -> void:\n",
    )
)

SIMULATIONS = {
    "rounds": ROUNDS,
    "fall": FALL,
    "mixed": MIXED,
    "choice": CHOICE,
    "endless": ENDLESS,
    "slow": SLOW,
    "slow_alone": SLOW,
    "leaky": LEAKY,
    "clean": CLEAN,
    "blind": ROUNDS.replace("observation_entries(", "entries("),
    "idle": ROUNDS.replace("action_components(", "components("),
    "lonely": ROUNDS.replace("policy_names(", "names("),
    "wrong_size": ROUNDS.replace(
        "episodes, created]", "episodes, created] if ticks < 6 or agent < 2 else [0.0]"
    ),
    "wrong_mask": ROUNDS.replace("[1, int(ticks % 4 == 0), 1]", "[1, 1]"),
    "broken": ROUNDS + "this is no GDScript\n",
    "no_simulation": "extends RefCounted\n",
}


def write_project(folder: Path) -> None:
    """Make a Godot project with a scene ``<name>.tscn`` for each simulation, and one without."""
    (folder / "project.godot").write_text(PROJECT)
    for name, text in SIMULATIONS.items():
        (folder / f"{name}.gd").write_text(text)
        properties = 'simulation_script = ExtResource("2")\n'
        properties += "episode_mode = 0\n" if name in {"mixed", "slow_alone"} else ""
        scene = SCENE.format(script=SCRIPT.format(name=name), properties=properties)
        (folder / f"{name}.tscn").write_text(scene)
    (folder / "no_script.tscn").write_text(SCENE.format(script="", properties=""))
    install_addon(folder)
