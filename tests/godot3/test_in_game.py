"""Policies play in real Godot 3 games without a trainer."""

from __future__ import annotations

import contextlib
import json
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import psutil
import pytest

from ludus.cli import main
from ludus.engine import EngineKind, InstalledEngine, find_engine
from ludus.engine.bundled import runnable_bundled_root
from ludus.errors import EngineCrashed
from ludus.export import engines as engine_runtimes
from ludus.export.convert import to_model
from ludus.export.parity import PolicyFiles, measure_parity, require_parity
from ludus.model import PolicyModel, write_model
from ludus.model.policy_model import Distribution, Linear
from ludus.play.in_engine import play_in_engine
from ludus.play.interactive import PlayConfig
from ludus.session import open_session
from ludus.settings.train_config import PolicyConfig, PPOConfig, SACConfig
from ludus.spec import PolicySpec
from ludus.wire.handshake import EngineConfig
from tests.export.test_godot import ATARI
from tests.export.trained_runs import MIXED, SIMPLE, make_policy
from tests.targets import find_game

pytestmark = [pytest.mark.engine, pytest.mark.timeout(300)]

FULL_LENGTH = 250
TARGET = "godot3:cartpole"
FOLLOW, FLEE = [0.0, 0.0, 1.0, 1.0], [0.0, 0.0, -1.0, -1.0]
Heard = list[tuple[str, int, float, int]]


@pytest.fixture(scope="module")
def cart() -> PolicySpec:
    """What the agent of CartPole declares."""
    with contextlib.closing(open_session(find_game(TARGET), EngineConfig())) as session:
        return session.policies["cart"]


@pytest.fixture(autouse=True)
def nothing_is_left() -> Iterator[None]:
    """No engine outlives a test."""
    yield
    assert godots() == []


def godots() -> list[int]:
    """Return the ids of all Godot 3 processes that play or test policies of these tests."""
    words = (str(engine_runtimes.SCRIPT3), "--ludus-report")
    return [
        process.pid
        for process in psutil.process_iter(["cmdline", "status", "ppid"])
        if any(word in (process.info["cmdline"] or ()) for word in words)
        and process.info["status"] != "zombie"
        and process.pid in {child.pid for child in psutil.Process().children(recursive=True)}
    ]


def linear_policy(spec: PolicySpec, push_right: list[float]) -> PolicyModel:
    """Push right where the weighted sum of the observation is positive, left elsewhere."""
    weight = np.array([[0.0] * 4, push_right], np.float32)
    return PolicyModel(
        policy="cart",
        fingerprint=spec.fingerprint(),
        observation=spec.observation,
        action=spec.action,
        has_action_mask=False,
        normalisation=None,
        images=(),
        memory=None,
        layers=(Linear(weight, np.zeros(2, np.float32), "none"),),
        distribution=Distribution(np.zeros(0, np.float32)),
    )


def play(path: Path, *, is_stochastic: bool = False, num_episodes: int = 3) -> Heard:
    heard: Heard = []

    def hear(policy: str, number: int, episode_return: float, length: int) -> None:
        heard.append((policy, number, episode_return, length))

    config = PlayConfig(target=TARGET, is_headless=True, num_episodes=num_episodes)
    play_in_engine(config, {"cart": path}, hear, is_stochastic=is_stochastic)
    return heard


def test_a_policy_balances_the_pole(cart: PolicySpec, tmp_path: Path) -> None:
    write_model(tmp_path / "best.ludus.json", linear_policy(cart, FOLLOW))
    heard = play(tmp_path / "best.ludus.json")
    assert heard == [("cart", i, FULL_LENGTH, FULL_LENGTH) for i in (1, 2, 3)]


def test_the_wrong_way_round_it_falls(cart: PolicySpec, tmp_path: Path) -> None:
    write_model(tmp_path / "worst.ludus.json", linear_policy(cart, FLEE))
    lengths = [length for *_, length in play(tmp_path / "worst.ludus.json")]
    assert all(0 < length < FULL_LENGTH / 2 for length in lengths)


def test_draws_are_not_the_most_probable_actions(cart: PolicySpec, tmp_path: Path) -> None:
    write_model(tmp_path / "best.ludus.json", linear_policy(cart, FOLLOW))
    # Its logits are close together, so half of all draws push the wrong way.
    lengths = [length for *_, length in play(tmp_path / "best.ludus.json", is_stochastic=True)]
    assert min(lengths) < FULL_LENGTH


def test_a_policy_that_does_not_fit_ends_the_game(cart: PolicySpec, tmp_path: Path) -> None:
    path = tmp_path / "other.ludus.json"
    write_model(path, linear_policy(cart, FOLLOW))
    content = json.loads(path.read_text())
    content["action"][0]["name"] = "jump"
    path.write_text(json.dumps(content))
    with pytest.raises(EngineCrashed, match="the policy decides this component") as error:
        play(path)
    assert error.value.process_exit_code == 1


# Plays a scene whose agent has a policy of its own, until the end of an episode.
OWN = """\
extends SceneTree
func _initialize() -> void:
	var scene = load("res://examples/cartpole/cartpole.tscn").instance()
	scene.get_node("LudusAgent").policy = LudusPolicy.load_file("{path}")
	root.add_child(scene)
	var player = {player}
	player.connect("episode_ended", self, "_tell")
func _tell(policy, agent, total, steps):
	printerr("%s of %s: %d in %d" % [policy, agent.name, total, steps])
	quit()
func _without_autoload():
	root.get_node("Ludus").free()
	var player = LudusPolicyPlayer.new()
	root.add_child(player)
	return player
"""


@pytest.mark.parametrize("player", ['root.get_node("Ludus").player', "_without_autoload()"])
def test_the_policy_of_a_scene_plays_without_arguments(
    cart: PolicySpec, godot3: InstalledEngine, tmp_path: Path, player: str
) -> None:
    path = tmp_path / "best.ludus.json"
    write_model(path, linear_policy(cart, FOLLOW))
    (tmp_path / "own.gd").write_text(OWN.format(path=path, player=player))
    program = str(godot3.executable(headless=True))
    root = str(runnable_bundled_root(EngineKind.GODOT3))
    done = subprocess.run(
        [program, "--fixed-fps", "60", "--path", root, "-s", str(tmp_path / "own.gd")],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    assert f"cart of LudusAgent: {FULL_LENGTH} in {FULL_LENGTH}\n" in done.stderr, done.stderr


@pytest.mark.parametrize(
    ("spec", "config"),
    [
        (SIMPLE, PPOConfig(hidden_sizes=(64, 64))),
        (MIXED, PPOConfig(hidden_sizes=(16, 7), activation="elu", squash=True)),
        (MIXED, PPOConfig(hidden_sizes=(9,), memory_size=7, state_dependent_std=True)),
        (MIXED, SACConfig(hidden_sizes=(16,), activation="silu", normalise_observation=False)),
        (ATARI, PPOConfig(hidden_sizes=(16,), activation="relu")),
    ],
    ids=["simple", "mixed", "memory", "sac", "atari"],
)
def test_godot3_computes_what_pytorch_does(
    spec: PolicySpec, config: PolicyConfig, tmp_path: Path
) -> None:
    policy = make_policy(spec, config, noise=0.01)
    model = to_model(policy, policy.spec)
    path = tmp_path / "policy.ludus.json"
    write_model(path, model)
    engine = find_engine(EngineKind.GODOT3)
    report = measure_parity(policy, model, PolicyFiles(path), engine, {})
    require_parity(report)
    assert report.comparisons[-1].runtime.startswith("Godot 3.")
    assert 0 < report.comparisons[-1].outputs <= 1e-4


def test_from_training_to_the_engine(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    train = ["train", TARGET, "--runs", str(tmp_path), "--name", "r", "--total-steps", "2048"]
    assert main([*train, "--num-worlds", "16", "--evaluation-episodes", "0"]) == 0
    run = str(tmp_path / "r")
    assert main(["export", run]) == 0
    output = capsys.readouterr().out
    assert re.search(r"^    Godot 3\.\S+ +outputs \S+", output, re.M), output
    assert main(["play", run, "--in-engine", "--headless", "--episodes", "2"]) == 0
    assert capsys.readouterr().out.count("cart") >= 2
