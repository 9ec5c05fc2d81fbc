"""Numbers that a real Godot game reports, on their way to every place where metrics go."""

from __future__ import annotations

from pathlib import Path

import pytest

import ludus
from ludus.addon import install_addon
from ludus.errors import GameError
from ludus.pool import PoolConfig, open_pool
from tests.actions import zeros
from tests.godot.conftest import PROJECT

pytestmark = pytest.mark.engine

# Reports its step, and at step 3 whatever the parameter `fault` says.
SCRIPT = """\
extends LudusAgent
var steps := 0
func _init() -> void:
	action = [LudusActionComponent.discrete("move", 2)]
	observation = [LudusObservationEntry.create("steps", [1])]
func apply_action(_action: int) -> void:
	steps += 1
	var own := LudusWorld.of(self)
	own.report_metric("steps", steps)
	match own.parameters.get("fault", "") if steps == 3 else "":
		"nan":
			own.report_metric("bad", NAN)
		"many":
			for i: int in 64:
				own.report_metric("metric %d" % i, i)
		"nameless":
			own.report_metric("", 1.0)
		"unprintable":
			own.report_metric("a\\u202e", 1.0)
func get_observation() -> Array:
	return [steps]
func get_reward() -> float:
	return 1.0
func is_done() -> bool:
	return steps == 4
func reset() -> void:
	steps = 0
"""
SCENE = """\
[gd_scene load_steps=2 format=3]
[ext_resource type="Script" path="res://right.gd" id="1"]
[node name="Game" type="Node"]
[node name="Hero" type="Node" parent="."]
script = ExtResource("1")
policy_name = "hero"
ticks_per_step = 1
"""


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("metrics")
    (folder / "project.godot").write_text(PROJECT)
    (folder / "right.gd").write_text(SCRIPT)
    (folder / "right.tscn").write_text(SCENE)
    install_addon(folder)
    return folder


def test_a_run_has_mean_lowest_highest_and_count_of_every_update(
    project: Path, tmp_path: Path
) -> None:
    run = ludus.train(
        project, runs=tmp_path, num_worlds=3, num_engines=2, total_steps=6 * 8 * 3,
        evaluation_episodes=0, ppo={"rollout_steps": 8},
    )  # fmt: skip
    assert [line["game"] for line in run.metrics] == [
        {"steps": {"mean": 2.5, "min": 1.0, "max": 4.0, "count": 48}}
    ] * 3


def test_metrics_of_all_worlds_and_engines_are_fetched_once(project: Path) -> None:
    with open_pool(project, PoolConfig(num_worlds=3, num_engines=2)) as pool:
        pool.reset(1)
        for _ in range(3):
            pool.step(zeros(pool))
        assert pool.take_requests() == []
        (metric,) = pool.take_metrics().values()
        assert (metric.count, metric.sum, metric.min, metric.max) == (18, 36.0, 1.0, 3.0)
        assert pool.take_metrics() == {}


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("nan", r"metric bad is nan, expected a finite number"),
        ("many", r"metric metric 63 is one more than the 64 that there may be"),
        ("nameless", r"a metric's name has 0 characters, expected 1 to 128"),
        ("unprintable", r'a metric\'s name is "a.*", expected only printable characters'),
    ],
)
def test_a_report_that_cannot_be_names_the_node(project: Path, fault: str, message: str) -> None:
    with open_pool(project, PoolConfig(num_worlds=2)) as pool:
        pool.reset(1, [None, {"fault": fault}])
        with pytest.raises(GameError, match=rf"/root/.*Game.*: {message}"):
            for _ in range(3):
                pool.step(zeros(pool))
