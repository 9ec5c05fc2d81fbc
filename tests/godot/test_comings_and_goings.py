"""Agents that end early, leave and join inside an episode (PROTOCOL.md §7), frame by frame."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from ludus.pool import EnginePool, PoolConfig, open_pool
from ludus.spec.batch import ActionBatch, Batches
from tests.godot_project import write_project
from tests.targets import find_scene

pytestmark = pytest.mark.engine
NUM_FRAMES = 10
# World 0 keeps its agents. In world 1 one leaves in step 2 and one joins at the end of step 3.
PARAMETERS = [{}, {"leave_at": 2, "join_at": 3}]
EARLY, LEAVER, SPARE = 0, 1, 2


@pytest.fixture(
    scope="module",
    params=itertools.product(("godot4:identity", "godot3:cartpole"), ("isolated", "grid")),
    ids="-".join,
)
def frames(request: pytest.FixtureRequest) -> Iterator[list[Batches]]:
    """Copies of all frames."""
    example, layout = request.param
    scene = find_scene(example).project.root / "examples/identity/oracle_world.tscn"
    with open_pool(scene, PoolConfig(num_worlds=2, layout=layout)) as pool:
        taken = [pool.reset(1, PARAMETERS)]
        taken += [pool.step(idle(pool)) for _ in range(NUM_FRAMES - 1)]
        yield taken


def idle(pool: EnginePool) -> dict[str, ActionBatch]:
    return {name: ActionBatch.zeros(own, own.num_agents) for name, own in pool.policies.items()}


def runners(frames: list[Batches], field: str, world: int) -> list[list[int]]:
    """One row per frame, one column per slot of that world."""
    rows = slice(3 * world, 3 * world + 3)
    return [getattr(batches["runner"], field)[rows].astype(int).tolist() for batches in frames]


def test_who_ends_early_waits_for_its_world(frames: list[Batches]) -> None:
    waits, both = [0, 1, 0], [1, 1, 0]
    assert runners(frames, "active", 0) == [
        both,
        both,
        waits,
        waits,
        waits,
        both,
        both,
        *[waits] * 3,
    ]
    watcher = [bool(batches["watcher"].active[0]) for batches in frames]
    assert all(watcher)
    ends = [bool(batches["watcher"].terminated[0]) for batches in frames]
    assert [frame for frame, ended in enumerate(ends) if ended] == [5]


def test_who_leaves_is_reported_once_and_who_joins_is_seen_at_once(frames: list[Batches]) -> None:
    alone, both = [0, 1, 0], [1, 1, 0]
    active = [both, both, [0, 0, 0], *[alone] * 5, both, both]
    assert runners(frames, "active", 1) == active
    ended = runners(frames, "terminated", 1)
    assert [frame for frame, row in enumerate(ended) if row[LEAVER]] == [2, 8]
    assert not any(row[SPARE] for row in ended)
    joiner_steps = [
        frames[i]["runner"].observation["observation"][3 + LEAVER, 1] for i in range(3, 8)
    ]
    assert joiner_steps == [0, 1, 2, 3, 4]


def test_final_observations(frames: list[Batches]) -> None:
    batch = frames[2]["runner"]
    assert batch.final_index.tolist() == [EARLY, 3 + EARLY, 3 + LEAVER]
    final = batch.final_observation["observation"]
    assert final[:2, 1].tolist() == [2, 2], "step in which Early ended"
    assert not final[2].any(), "an agent that left has observed zeros"
    np.testing.assert_allclose(batch.reward, [0.2, 0.2, 0, 0.2, 0, 0], atol=1e-6)


def test_inactive_slots_observe_zeros(frames: list[Batches]) -> None:
    for batches in frames:
        batch = batches["runner"]
        assert not batch.observation["observation"][~batch.active].any()


def test_a_world_that_lost_agents_is_made_anew(frames: list[Batches]) -> None:
    anew = frames[8]["runner"].observation["observation"][3:]
    assert anew[[EARLY, LEAVER], 1].tolist() == [0, 0]
    following = frames[9]["runner"].observation["observation"][3:]
    assert following[[EARLY, LEAVER], 1].tolist() == [1, 1]
    assert following[[EARLY, LEAVER], 4].tolist() == [2, 2], "both ticks of the first step count"
    assert frames[8]["watcher"].active.all()


# In step 3 Unit leaves. Late joins, in the step that its world's parameter says, and gets its slot.
UNIT = """\
extends LudusAgent
var steps := 0
var resets := 0
func _init() -> void:
	action = [LudusActionComponent.discrete("push", 3)]
	ticks_per_step = 1
func apply_action(_action: int) -> void:
	steps += 1
	if name != "Boss":
		return
	if steps == int(LudusWorld.of(self).parameters.get("join_at", 0)):
		var late: Node = get_script().new()
		late.name = "Late"
		get_parent().add_child(late)
	if steps == 3:
		get_parent().get_node("Unit").queue_free()
func get_observation() -> Array:
	return [resets]
func get_reward() -> float:
	return 0.0
func is_done() -> bool:
	return false
func reset() -> void:
	resets += 1
	steps = 0
func ludus_steps() -> int:
	return steps
"""
UNITS_SCENE = {
    "godot4": """\
[gd_scene format=3]
[ext_resource path="res://unit.gd" type="Script" id="1"]
[node name="Level" type="Node"]
[node name="Unit" type="Node" parent="."]
script = ExtResource("1")
[node name="Boss" type="Node" parent="."]
script = ExtResource("1")
""",
    "godot3": """\
[gd_scene format=2]
[ext_resource path="res://unit.gd" type="Script" id=1]
[node name="Level" type="Node"]
[node name="Unit" type="Node" parent="."]
script = ExtResource( 1 )
[node name="Boss" type="Node" parent="."]
script = ExtResource( 1 )
""",
}


@pytest.fixture(params=UNITS_SCENE)
def units(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    files = {"unit.gd": UNIT, "level.tscn": UNITS_SCENE[request.param]}
    return write_project(tmp_path / "units", files, main="level", kind=request.param)


def test_a_newcomer_goes_on_as_it_is_in_a_slot_freed_in_the_same_step(units: Path) -> None:
    with open_pool(units, PoolConfig(num_worlds=2)) as pool:
        pool.reset(1, [{"join_at": 3}, {"join_at": 4}])
        for number in (1, 2, 3, 4):
            batch = pool.step(idle(pool))["agent"]
            assert batch.active.tolist() == [True, True, number != 3, True]
            assert batch.terminated.tolist() == [number == 3, False] * 2
    assert batch.observation["observation"][:, 0].tolist() == [0, 1, 0, 1], "calls of reset()"


def test_a_newcomer_without_a_slot_gets_the_next_free_one(units: Path, tmp_path: Path) -> None:
    with open_pool(units, PoolConfig(num_worlds=2, log_dir=tmp_path)) as pool:
        pool.reset(1, [{"join_at": 1}, {}])
        for number in (1, 2, 3, 4):
            batch = pool.step(idle(pool))["agent"]
            assert batch.active.tolist() == [True, True, number < 3, True]
            assert batch.terminated.tolist() == [number == 3, False] * 2
    assert batch.observation["observation"][:, 0].tolist() == [0, 1, 0, 1], "calls of reset()"
    logs = "".join(file.read_text() for file in tmp_path.glob("*.log"))
    assert logs.count("no free slot for agent Late of policy agent") == 1


def test_random_play_inside_the_engine_goes_on_when_an_agent_leaves(
    units: Path, tmp_path: Path
) -> None:
    """What ``ludus bench`` calls the ceiling."""
    with open_pool(units, PoolConfig(log_dir=tmp_path)) as pool:
        pool.call({"bridge": True}, "run_ceiling", [10, 1])
        assert pool.call({"world": 0, "agent": "Boss"}, "ludus_steps") == [10]
    assert "SCRIPT ERROR" not in (tmp_path / "engine-0.log").read_text()
