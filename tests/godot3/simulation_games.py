"""The scripts of ``tests/godot/simulation_games.py`` in the dialect of Godot 3."""

from __future__ import annotations

from pathlib import Path

from ludus.addon import install_addon

__all__ = ["write_project"]

PROJECT = """\
config_version=4

[application]

config/name="Simulations"
run/main_scene="res://rounds.tscn"

[logging]

file_logging/enable_file_logging=false
"""

SCENE = """\
[gd_scene format=2]
[ext_resource path="res://addons/ludus/ludus_simulation_host.gd" type="Script" id=1]
{script}
[node name="Game" type="Node2D"]
script = ExtResource( 1 )
{properties}
"""
SCRIPT = '[ext_resource path="res://{name}.gd" type="Script" id=2]'

# Two runners and a watcher. Runner 0 ends after 2 steps, runner 1 after 3, the round after 5.
ROUNDS = """\
extends LudusSimulation
var ticks := 0
var episodes := 0
var created := 0
var draw := 0.0
var last := [-1, -1, -1]
var sums := [0, 0, 0]
func policy_names() -> PoolStringArray:
	return PoolStringArray(["runner", "runner", "watcher"])
func observation_entries(_policy: String) -> Array:
	return [LudusObservationEntry.create("observation", PoolIntArray([6]))]
func action_components(_policy: String) -> Array:
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
	var _number := world.rng.randf()
func begin_episode() -> void:
	ticks = 0
	episodes += 1
	draw = world.rng.randf()
	last = [-1, -1, -1]
	sums = [0, 0, 0]
func apply_action(agent: int, action) -> void:
	last[agent] = action
	sums[agent] += action
func advance() -> void:
	ticks += 1
func get_observation(agent: int):
	return PoolRealArray([agent, ticks, sums[agent], draw, episodes, created])
func get_reward(agent: int) -> float:
	return float(agent + last[agent])
func is_done(agent: int) -> bool:
	return (agent == 0 and ticks >= 4) or (agent == 1 and ticks >= 6)
func has_action_mask(policy: String) -> bool:
	return policy == "watcher"
func get_action_mask(_agent: int) -> PoolByteArray:
	return PoolByteArray([1, int(ticks % 4 == 0), 1])
func count_episodes(factor: int) -> int:
	return episodes * factor
"""

# A 2D ball and a 3D box that fall, each in its space; both are there only when 3 ticks have passed.
FALL = """\
extends LudusSimulation
var ball: RID
var box: RID
var ticks_to_create := 0
func policy_names() -> PoolStringArray:
	return PoolStringArray(["ball"])
func observation_entries(_policy: String) -> Array:
	return [LudusObservationEntry.create("observation", PoolIntArray([7]))]
func action_components(_policy: String) -> Array:
	return [LudusActionComponent.continuous("push", 2)]
func ticks_per_step() -> int:
	return 2
func max_episode_steps() -> int:
	return 20
func create() -> void:
	var disc := own_2d(Physics2DServer.circle_shape_create())
	Physics2DServer.shape_set_data(disc, 10.0)
	ball = own_2d(Physics2DServer.body_create())
	Physics2DServer.body_add_shape(ball, disc)
	Physics2DServer.body_set_space(ball, space_2d())
	var slab := own_2d(Physics2DServer.rectangle_shape_create())
	Physics2DServer.shape_set_data(slab, Vector2(500, 10))
	var ground := own_2d(Physics2DServer.body_create())
	Physics2DServer.body_set_mode(ground, Physics2DServer.BODY_MODE_STATIC)
	Physics2DServer.body_add_shape(ground, slab)
	Physics2DServer.body_set_space(ground, space_2d())
	var below := Transform2D(0.0, offset_2d + Vector2(0, 60))
	Physics2DServer.body_set_state(ground, Physics2DServer.BODY_STATE_TRANSFORM, below)
	var cube := own_3d(PhysicsServer.shape_create(PhysicsServer.SHAPE_BOX))
	PhysicsServer.shape_set_data(cube, Vector3.ONE)
	box = own_3d(PhysicsServer.body_create())
	PhysicsServer.body_add_shape(box, cube)
	PhysicsServer.body_set_space(box, space_3d())
	for _i in 3:
		yield(self, "ticked")
		ticks_to_create += 1
func begin_episode() -> void:
	var start := offset_2d + Vector2(world.rng.randf_range(-50, 50), 0)
	Physics2DServer.body_set_state(
		ball, Physics2DServer.BODY_STATE_TRANSFORM, Transform2D(0.0, start))
	Physics2DServer.body_set_state(ball, Physics2DServer.BODY_STATE_LINEAR_VELOCITY, Vector2.ZERO)
	Physics2DServer.body_set_state(ball, Physics2DServer.BODY_STATE_ANGULAR_VELOCITY, 0.0)
	PhysicsServer.body_set_state(
		box, PhysicsServer.BODY_STATE_TRANSFORM, Transform(Basis(), offset_3d))
	PhysicsServer.body_set_state(box, PhysicsServer.BODY_STATE_LINEAR_VELOCITY, Vector3.ZERO)
func apply_action(_agent: int, action) -> void:
	Physics2DServer.body_apply_central_impulse(ball, Vector2(action[0], action[1]) * 10.0)
func where() -> Vector2:
	return Physics2DServer.body_get_state(ball, Physics2DServer.BODY_STATE_TRANSFORM).origin
func get_observation(_agent: int):
	var at := where() - offset_2d
	var speed: Vector2 = Physics2DServer.body_get_state(
		ball, Physics2DServer.BODY_STATE_LINEAR_VELOCITY)
	var place: Transform = PhysicsServer.body_get_state(box, PhysicsServer.BODY_STATE_TRANSFORM)
	var high := place.origin.y - offset_3d.y
	return PoolRealArray([at.x, at.y, speed.x, speed.y, high, ticks_to_create, find_ball()])
func find_ball() -> int:
	var hits := Physics2DServer.space_get_direct_state(space_2d()).intersect_point(where())
	var count := 0
	for hit in hits:
		count += int(hit["rid"] == ball)
	return count
func get_reward(_agent: int) -> float:
	return 1.0
"""

# Dictionaries both ways; each agent's episode ends by itself: agent 0 is done, agent 1 cut off.
MIXED = """\
extends LudusSimulation
var steps := [0, 0]
var begun := [0, 0]
var aims := [PoolRealArray([0, 0]), PoolRealArray([0, 0])]
var moves := [0, 0]
func policy_names() -> PoolStringArray:
	return PoolStringArray(["one", "other"])
func observation_entries(_policy: String) -> Array:
	return [
		LudusObservationEntry.create("aim", PoolIntArray([2])),
		LudusObservationEntry.create(
			"counts", PoolIntArray([3]), LudusObservationEntry.DType.INT64)]
func action_components(_policy: String) -> Array:
	return [LudusActionComponent.continuous("aim", 2), LudusActionComponent.discrete("move", 4)]
func begin_episode() -> void:
	for agent in 2:
		begin_agent_episode(agent)
func begin_agent_episode(agent: int) -> void:
	steps[agent] = 0
	begun[agent] += 1
func apply_action(agent: int, action) -> void:
	aims[agent] = action["aim"]
	moves[agent] = action["move"]
func advance() -> void:
	for agent in 2:
		steps[agent] += 1
func get_observation(agent: int):
	return {"counts": [steps[agent], begun[agent], moves[agent]], "aim": aims[agent]}
func is_done(agent: int) -> bool:
	return agent == 0 and steps[agent] == 2
func is_truncated(agent: int) -> bool:
	return agent == 1 and steps[agent] == 3
"""

# The observation says which of 3 moves is right; a round is 10 moves.
CHOICE = """\
extends LudusSimulation
var wanted := [0, 0]
var chosen := [0, 0]
var rewards := [0.0, 0.0]
func policy_names() -> PoolStringArray:
	return PoolStringArray(["chooser", "chooser"])
func observation_entries(_policy: String) -> Array:
	var entry := LudusObservationEntry.create("wanted", PoolIntArray([3]))
	entry.low = 0.0
	entry.high = 1.0
	return [entry]
func action_components(_policy: String) -> Array:
	return [LudusActionComponent.discrete("choice", 3)]
func max_episode_steps() -> int:
	return 10
func begin_episode() -> void:
	for agent in 2:
		wanted[agent] = world.rng.randi_range(0, 2)
func apply_action(agent: int, action) -> void:
	chosen[agent] = action
func advance() -> void:
	for agent in 2:
		rewards[agent] = float(chosen[agent] == wanted[agent])
		wanted[agent] = world.rng.randi_range(0, 2)
func get_observation(agent: int):
	var seen := PoolRealArray([0, 0, 0])
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
		yield(self, "ticked")
"""

# The number of ticks that an episode takes to begin depends on world and episode.
SLOW = """\
extends "res://fall.gd"
var num_begun := 0
func begin_episode() -> void:
	num_begun += 1
	for _i in num_begun + 2 * world.index:
		yield(self, "ticked")
	.begin_episode()
func max_episode_steps() -> int:
	return 0
func is_done(_agent: int) -> bool:
	return world.index == 1 and find_ball() == 1 and num_begun < 3
"""

# Leaves bodies, an area, and the shapes that they have; the area has one twice.
LEAKY = """\
extends "res://rounds.gd"
func create() -> void:
	var shape := Physics2DServer.circle_shape_create()
	Physics2DServer.shape_set_data(shape, 10.0)
	var body := Physics2DServer.body_create()
	Physics2DServer.body_add_shape(body, shape)
	Physics2DServer.body_set_space(body, space_2d())
	var area := Physics2DServer.area_create()
	Physics2DServer.area_add_shape(area, shape)
	Physics2DServer.area_add_shape(area, shape)
	Physics2DServer.area_set_space(area, space_2d())
	var place := Transform2D(0.0, offset_2d)
	Physics2DServer.area_set_transform(area, place)
	Physics2DServer.body_set_state(body, Physics2DServer.BODY_STATE_TRANSFORM, place)
	var sphere := PhysicsServer.shape_create(PhysicsServer.SHAPE_SPHERE)
	PhysicsServer.shape_set_data(sphere, 1.0)
	var rock := PhysicsServer.body_create()
	PhysicsServer.body_add_shape(rock, sphere)
	PhysicsServer.body_set_state(
		rock, PhysicsServer.BODY_STATE_TRANSFORM, Transform(Basis(), offset_3d))
	PhysicsServer.body_set_space(rock, space_3d())
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
        "\tfor rid in [body, area, shape]:\n\t\tPhysics2DServer.free_rid(rid)\n"
        "\tfor rid in [rock, sphere]:\n\t\tPhysicsServer.free_rid(rid)\n"
        "func create() -> void:\n",
    )
)

# Too many spaces for Bullet.
CROWD = ROUNDS.replace("\tcreated += 1\n", "\tcreated += 1\n\tvar _space := space_3d()\n")

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
    "crowd": CROWD,
    "blind": ROUNDS.replace("observation_entries(", "entries("),
    "idle": ROUNDS.replace("action_components(", "components("),
    "lonely": ROUNDS.replace("policy_names(", "names("),
    "wrong_size": ROUNDS.replace(
        "\treturn PoolRealArray([agent,",
        "\tif ticks >= 6 and agent == 2:\n\t\treturn [0.0]\n\treturn PoolRealArray([agent,",
    ),
    "wrong_mask": ROUNDS.replace("[1, int(ticks % 4 == 0), 1]", "[1, 1]"),
    "broken": ROUNDS + "this is no GDScript\n",
    "no_simulation": "extends Reference\n",
}


def write_project(folder: Path) -> None:
    """Make a Godot 3 project with a scene ``<name>.tscn`` for each simulation, and one without."""
    (folder / "project.godot").write_text(PROJECT)
    for name, text in SIMULATIONS.items():
        (folder / f"{name}.gd").write_text(text)
        properties = "simulation_script = ExtResource( 2 )\n"
        properties += "episode_mode = 0\n" if name in {"mixed", "slow_alone"} else ""
        scene = SCENE.format(script=SCRIPT.format(name=name), properties=properties)
        (folder / f"{name}.tscn").write_text(scene)
    (folder / "no_script.tscn").write_text(SCENE.format(script="", properties=""))
    install_addon(folder)
