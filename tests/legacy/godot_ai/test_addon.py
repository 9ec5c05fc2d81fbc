"""A game for godot-ai on our add-on, its scripts unchanged, on real Godot."""

from __future__ import annotations

import re
import struct
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from ludus.engine import (
    EngineKind,
    EngineProcess,
    GodotFlags,
    LaunchConfig,
    ensure_imported,
    find_engine,
    godot_command,
    read_project,
)
from ludus.engine.project import RUN_SCENE
from ludus.link import Link, Listener
from ludus.pool import EnginePool, PoolConfig, open_pool
from ludus.runs.metrics import read_metrics
from ludus.session import LaunchOptions
from ludus.settings.train_config import TrainConfig
from ludus.spec.batch import ActionBatch, Batches
from ludus.training.loop import train
from ludus.wire.frames import FrameType
from tests.legacy.godot_ai.projects import Events, legacy_addon_game
from tests.raw_trainer import TOKEN_ENV, greet
from tests.wire.golden import load
from tests.wire.reference import frame, json_frame

pytestmark = pytest.mark.engine

NUM_WORLDS = 3
STEPS_IN_ROUND = 10
STEP_LENGTH = 0.25
GOAL_RADIUS = 0.15
POSITION, GOAL = slice(0, 2), slice(2, 4)
ALARM = re.compile(r"leak|error|warning|orphan|still in use|behind", re.IGNORECASE)


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return legacy_addon_game(tmp_path_factory.mktemp("addon") / "game")


@pytest.fixture
def log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """File in which the game writes down what happens."""
    file = tmp_path / "log.txt"
    monkeypatch.setenv("POINT_LOG", str(file))
    return file


@pytest.fixture
def pool(project: Path, log: Path) -> Iterator[EnginePool]:
    with open_pool(project, PoolConfig(num_worlds=NUM_WORLDS)) as opened:
        yield opened


def straight(pool: EnginePool, batches: Batches, names: tuple[str, ...]) -> dict[str, ActionBatch]:
    """Let some policies go straight to their goals, and the others nowhere."""
    actions: dict[str, ActionBatch] = {}
    for name, policy in pool.policies.items():
        action = ActionBatch.zeros(policy, policy.num_agents)
        if name in names:
            state = batches[name].observation["state"]
            away = state[:, GOAL] - state[:, POSITION]
            assert action.continuous is not None
            action.continuous[:] = np.clip(away / STEP_LENGTH, -1, 1)
        actions[name] = action
    return actions


def test_the_spec_is_what_the_environment_says(pool: EnginePool) -> None:
    assert (pool.spec.num_worlds, pool.spec.ticks_per_step) == (NUM_WORLDS, 2)
    walker, drifter = pool.spec.policies
    assert (walker.name, drifter.name) == ("walker", "drifter")
    for policy in (walker, drifter):
        assert (policy.episode, policy.max_episode_steps) == ("world", STEPS_IN_ROUND)
        assert [(part.name, part.shape) for part in policy.observation] == [("state", (4,))]
        assert (policy.action[0].name, policy.continuous_size) == ("action", 2)
    assert dict(walker.settings) == {
        "algorithm": "sac", "activation": "relu", "learning_rate": 3e-4, "discount": 0.99,
        "hidden_sizes": [48, 48], "critic_hidden_sizes": [48, 48, 48], "batch_size": 128,
        "replay_capacity": 5000, "updates_per_step": 2.5, "target_rate": 0.005,
        "target_entropy": -2.0, "learning_starts": 0, "normalise_observation": False,
        "save_replay": False, "report_steps": STEPS_IN_ROUND,
    }  # fmt: skip
    assert drifter.settings["replay_capacity"] == 128, "never less than a batch"


def test_actions_reach_and_scores_arrive_as_rewards(pool: EnginePool) -> None:
    before = pool.reset(3)["walker"].observation["state"].copy()
    num_compared = 0
    for _ in range(STEPS_IN_ROUND - 1):
        policy = pool.policies["walker"]
        actions = {n: ActionBatch.zeros(p, p.num_agents) for n, p in pool.policies.items()}
        moves = np.random.default_rng(num_compared).uniform(-1, 1, (policy.num_agents, 2))
        actions["walker"].continuous[:] = moves  # pyright: ignore[reportOptionalSubscript]
        batch = pool.step(actions)["walker"]
        after = batch.observation["state"]
        plays = (batch.active == 1) & (batch.terminated == 0)
        expected = before[:, POSITION] + STEP_LENGTH * moves
        np.testing.assert_allclose(after[plays, POSITION], expected[plays], atol=1e-5)
        nearer = [
            np.linalg.norm(state[:, GOAL] - state[:, POSITION], axis=1) for state in (before, after)
        ]
        score = 10.0 * (nearer[0] - nearer[1])
        np.testing.assert_allclose(batch.reward[plays], score[plays], atol=1e-4)
        num_compared += int(plays.sum())
        before = after.copy()
        if not plays.all():
            break
    assert num_compared >= NUM_WORLDS


def test_who_is_done_waits_for_the_end_of_the_round(pool: EnginePool, log: Path) -> None:
    batches = pool.reset(5)
    num_waiting = num_early = 0
    for step in range(1, 5 * STEPS_IN_ROUND + 1):
        batches = pool.step(straight(pool, batches, ("walker",)))
        walker, drifter = batches["walker"], batches["drifter"]
        if step == STEPS_IN_ROUND:
            assert drifter.truncated.sum() + drifter.terminated.sum() + num_early >= NUM_WORLDS
        num_early += int(drifter.terminated.sum())
        waits = (walker.active == 0) & (drifter.active == 1)
        assert np.all(walker.observation["state"][walker.active == 0] == 0.0)
        num_waiting += int(waits.sum())
    assert num_waiting > NUM_WORLDS, "walkers that reached their goals waited for the others"
    pool.close()
    acts = Events(log).of("act")
    assert {act[2] for act in acts} == {"0"}, "nobody acts who is done"
    assert {act[3] for act in acts} == {"<null>"}, "the callback"
    walked = sum(act[1] == "0" for act in acts)
    assert walked == 5 * STEPS_IN_ROUND * NUM_WORLDS - num_waiting, "once a step"


def test_every_round_has_a_new_simulation_that_is_cleaned_once(pool: EnginePool, log: Path) -> None:
    batches = pool.reset(1)
    num_ends = 0
    for _ in range(3 * STEPS_IN_ROUND):
        batches = pool.step(straight(pool, batches, ("walker", "drifter")))
        num_ends += sum(len(batch.final_index) for batch in batches.values())
    batches = pool.reset(2)
    pool.close()
    events = Events(log)
    begun = events.counts("new")
    assert len(begun) >= 2 * NUM_WORLDS + num_ends // 4 > 4 * NUM_WORLDS
    assert set(begun.values()) == {1}
    latest = sorted(begun, key=int)[-NUM_WORLDS:]
    assert events.counts("clean") == begun - Counter(latest)
    assert {row[2] for row in events.of("begun")} == {"2"}, "both bodies are found by queries"
    assert not events.of("display"), "nothing is drawn without a window"


def test_equal_seeds_give_equal_rounds(pool: EnginePool) -> None:
    first = pool.reset(9)["walker"].observation["state"].copy()
    pool.step({n: ActionBatch.zeros(p, p.num_agents) for n, p in pool.policies.items()})
    again = pool.reset(9)["walker"].observation["state"]
    np.testing.assert_array_equal(first, again)
    assert len(np.unique(first, axis=0)) == NUM_WORLDS


RESET = frame("RESET", struct.pack("<II", 2, 4) + bytes(16) + bytes([2, 2]) + bytes(6) + b"null")


def play(link: Link) -> None:
    """Train two worlds that are made twice, and say goodbye, unless the game fails."""
    greet(link)
    config = {"scene": "res://Point/PointEnv.tscn", "num_worlds": 2, "layout": "scene"}
    link.send(json_frame("WELCOME", {**load("welcome").content, "config": config}))
    assert link.receive()[0] is FrameType.SPEC
    for _ in range(2):
        link.send(RESET)
        if link.receive()[0] is FrameType.ERROR:
            return
        for _ in range(2 * STEPS_IN_ROUND):
            link.send(frame("STEP", bytes(32)))
            assert link.receive()[0] is FrameType.BATCH
    link.send(frame("CLOSE", b""))


def last_words(project: Path, output: Path) -> tuple[int | None, str]:
    """Return exit code and output of a verbose engine that has played and ended by itself."""
    engine = find_engine(EngineKind.GODOT4)
    ensure_imported(engine, read_project(project))
    listener = Listener()
    flags = GodotFlags(user_args=(f"--ludus-connect={listener.addresses[0]}",))
    program, *rest = godot_command(engine, project, RUN_SCENE, flags)
    command = (program, "--verbose", *rest)
    with EngineProcess.start(
        LaunchConfig(command=command, env=TOKEN_ENV, log_path=output)
    ) as process:
        link = listener.accept(20.0, lambda: None)
        listener.close()
        play(link)
        code = process.wait(20.0)
        link.close()
    return code, output.read_text()


@pytest.mark.parametrize("is_endless", [False, True])
def test_nothing_is_left_behind(
    is_endless: bool, project: Path, log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if is_endless:
        monkeypatch.setenv("POINT_ENDLESS", "1")
    code, output = last_words(project, tmp_path / "engine.log")
    assert code == int(is_endless)
    alarms = [line for line in output.splitlines() if ALARM.search(line)]
    assert [line for line in alarms if "Orphan StringName" not in line] == []
    complaint = "world 0: res://Point/PointSimulation.gd: create() and begin_episode() are not over"
    assert (complaint in output) == is_endless
    events = Events(log)
    assert len(events.of("new")) >= (2 if is_endless else 8)
    assert events.counts("clean") == events.counts("new")
    assert set(events.counts("clean").values()) == {1}


def test_scenes_that_name_a_path_of_godot_ai(project: Path, tmp_path: Path) -> None:
    engine = find_engine(EngineKind.GODOT4)
    ensure_imported(engine, read_project(project))
    script = project / "by_path.gd"
    script.write_text(
        "extends SceneTree\n"
        "func _initialize():\n"
        '\tvar node = load("res://AI/AIServerTCP.tscn").instantiate()\n'
        '\tvar by_path = load("res://AI/BaseSimulation.gd").new()\n'
        '\tprinterr("found ", node is AIServerTCP, " ", by_path is BaseSimulation)\n'
        "\tnode.free()\n"
        "\tquit()\n"
    )
    program = str(engine.executable(headless=True))
    command = (program, "--headless", "--path", str(project), "-s", "res://by_path.gd")
    log = tmp_path / "engine.log"
    with EngineProcess.start(LaunchConfig(command=command, log_path=log)) as process:
        assert process.wait(30.0) == 0
        assert process.script_errors == []
    script.unlink()
    assert "found true true" in log.read_text()


@pytest.mark.screen
def test_only_some_simulations_are_shown(project: Path, log: Path) -> None:
    config = PoolConfig(num_worlds=5, launch=LaunchOptions(is_windowed=True))
    with open_pool(project, config) as pool:
        batches = pool.reset(1)
        for _ in range(STEPS_IN_ROUND - 1):
            batches = pool.step(straight(pool, batches, ()))
    shown = [row[0] for row in Events(log).of("display")]
    assert len(shown) >= 3
    latest = [row[0] for row in Events(log).of("new")][-5:]
    assert set(shown[-3:]) <= set(latest[:3])
    assert len(set(shown[-3:])) == 3, "get_number_of_simulations_to_display"


def test_the_map_of_each_epoch_holds_in_its_round(
    project: Path, log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("POINT_TURNS", "1")
    config = TrainConfig(
        target=str(project), num_worlds=4, num_engines=1, seed=3, total_steps=400,
        evaluation_episodes=0, runs=tmp_path, name="run",
    )  # fmt: skip
    result = train(config)
    learning = [
        [line["policies"][name]["is_learning"] for name in ("walker", "drifter")]
        for line in read_metrics(result.path / "metrics.jsonl")
    ]
    epochs = len(learning)
    assert epochs >= 5
    assert learning == [[epoch % 2, 1 - epoch % 2] for epoch in range(1, epochs + 1)]
    events = Events(log)
    # After the last epoch the game is told that the next begins, as it cannot know the limit.
    assert [int(row[0]) for row in events.of("map")] == list(range(1, epochs + 2))
    words = ("playing", "submitting", "training", "Done Training")
    expected = [f"{epoch} {word}" for epoch in range(1, epochs + 1) for word in words]
    told = [" ".join(row) for row in events.of("status")]
    first = told.index("1 playing")
    assert told[first:] == [*expected, f"{epochs + 1} playing"]
    (output,) = result.path.rglob("engine*.log")
    lines = output.read_text().splitlines()
    assert [line for line in lines if line.startswith("Epoch: ")] == [
        f"Epoch: {epoch}" for epoch in range(1, epochs + 2)
    ]
    assert "Agent named walker initialized." in lines
    assert "Replay Capacity: 5000" in lines
    assert "Checkpoint not loaded for: walker (there is none)" in lines


@pytest.mark.slow
@pytest.mark.training
def test_it_learns_and_obeys_the_map(
    project: Path, log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("POINT_DRIFTER_LEARNS_FROM", "25")
    config = TrainConfig(
        target=str(project), num_worlds=16, num_engines=1, seed=3, total_steps=16_000,
        max_time_s=150.0, evaluation_episodes=0, runs=tmp_path, name="run",
    )  # fmt: skip
    result = train(config)
    lines = read_metrics(result.path / "metrics.jsonl")
    returns = [line["policies"]["walker"]["mean_return"] for line in lines]
    assert abs(returns[0]) < 3.0, "a network that has learnt nothing goes nowhere"
    assert returns[-1] > 6.0, f"straight to the goal is about 9: {returns}"
    is_learning = [line["policies"]["drifter"]["is_learning"] for line in lines]
    start = is_learning.index(1)
    assert start > 0
    assert set(is_learning[:start]) == {0}
    assert set(is_learning[start + 1 :]) == {1}
    epochs = len(lines)
    assert start == 24, "the map says so from epoch 25 on"
    assert [int(row[0]) for row in Events(log).of("map")] == list(range(1, epochs + 2))
