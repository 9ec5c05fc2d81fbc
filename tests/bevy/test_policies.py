"""Policies play inside the Bevy example, without Python, as they do with it."""

from __future__ import annotations

import json
import subprocess
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import pytest

from ludus.cli.main import main
from ludus.engine.bundled import bevy_workspace
from ludus.errors import EngineError, EngineTimeout, ParityError
from ludus.export import engines
from ludus.export.convert import to_model
from ludus.export.engines import BevyGame
from ludus.export.exporting import ExportConfig, export_policies
from ludus.export.parity import ParityReport, PolicyFiles, measure_parity, require_parity
from ludus.model import read_model
from ludus.model.json_file import write_model
from ludus.networks.policy import Policy
from ludus.pool import PoolConfig, open_pool
from ludus.session import LaunchOptions
from ludus.settings.train_config import PolicyConfig, PPOConfig, SACConfig
from tests.actions import zeros
from tests.bevy.conftest import TARGET, processes
from tests.export.test_godot import ATARI
from tests.export.trained_runs import MIXED, SIMPLE, make_policy
from tests.legacy.gymgodot.conftest import left_processes
from tests.model.golden import model_path

pytestmark = [pytest.mark.engine, pytest.mark.bevy, pytest.mark.timeout(180, func_only=True)]

DEADLINE_S = 60.0
PREFIX = "ludus-episode "
"""How a game begins a line that reports an episode."""


@pytest.fixture(scope="module")
def run(executable: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run in which the pole is balanced almost always."""
    folder = tmp_path_factory.mktemp("runs")
    arguments = ["--target-return", "249", "--seed", "1", "--runs", str(folder), "--name", "cart"]
    assert main(["train", TARGET, *arguments]) == 0
    return folder / "cart"


@contextmanager
def playing(executable: Path, *arguments: str) -> Generator[subprocess.Popen[str]]:
    """Run the game alone; no process is left behind."""
    with subprocess.Popen(
        [str(executable), "--ludus-headless", "--ludus-report", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as game:
        try:
            yield game
        finally:
            game.kill()
    assert processes(executable) == []


def reports(game: subprocess.Popen[str], count: int) -> list[dict[str, float]]:
    """Read what a game tells of its first episodes."""
    assert game.stdout is not None
    lines = [game.stdout.readline() for _ in range(count)]
    assert all(line.startswith(PREFIX) for line in lines), lines
    return [json.loads(line.removeprefix(PREFIX)) for line in lines]


def test_an_exported_policy_plays_alone_as_evaluate_says(
    run: Path, executable: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    assert main(["evaluate", str(run), "--episodes", "20", "--json"]) == 0
    evaluated = json.loads(capsys.readouterr().out)["policies"]
    file = tmp_path / "cart.ludus.json"
    assert main(["export", str(run), "--to", str(file)]) == 0
    text = capsys.readouterr().out
    assert "Bevy          outputs " in text
    assert "Godot" not in text
    with playing(executable, f"--ludus-policy=cart={file}") as game:
        heard = reports(game, 20)
    mean_return = sum(report["return"] for report in heard) / len(heard)
    assert {report["policy"] for report in heard} == {"cart"}
    assert all(report["length"] == report["return"] <= 250.0 for report in heard)
    expected = float(evaluated["cart"]["mean_return"])
    assert expected > 240.0
    assert abs(mean_return - expected) <= 10.0


def test_drawn_actions_are_another_game(run: Path, executable: Path, tmp_path: Path) -> None:
    write_untrained(tmp_path / "cart.ludus.json", run)
    policy = f"--ludus-policy=cart={tmp_path / 'cart.ludus.json'}"
    with playing(executable, policy) as game:
        fixed = reports(game, 30)
    with playing(executable, policy, "--ludus-sample") as game:
        drawn = reports(game, 30)
    # The untrained one pushes to one side only, and so falls at once.
    assert max(report["length"] for report in fixed) <= 15
    assert max(report["length"] for report in drawn) > 15


def write_untrained(path: Path, run: Path) -> None:
    """Write the policy of a run whose last layer is nothing."""
    (exported,) = export_policies(ExportConfig(run=run, to=str(path), is_tested=False))
    model = read_model(exported.path)
    last = model.layers[-1]
    last.weight[:] = 0.0
    last.bias[:] = 0.0
    write_model(path, model)


@pytest.mark.parametrize("arguments", [[], ["--in-engine"], ["--in-engine", "--stochastic"]])
def test_ludus_play(
    run: Path, executable: Path, capsys: pytest.CaptureFixture[str], arguments: list[str]
) -> None:
    capsys.readouterr()
    assert main(["play", str(run), "--headless", "--episodes", "3", *arguments]) == 0
    *lines, _mean = capsys.readouterr().out.splitlines()
    assert [line.split(",")[0] for line in lines] == [f"cart: episode {i}" for i in (1, 2, 3)]
    returns = [float(line.split("return ")[1].split(" ")[0]) for line in lines]
    assert all(100.0 < value <= 250.0 for value in returns), returns
    assert processes(executable) == []


def test_the_example_brings_its_policy_along(executable: Path) -> None:
    workspace = bevy_workspace()
    assert workspace is not None
    shipped = workspace / "examples/cartpole/cart.ludus.json"
    assert read_model(shipped).policy == "cart"
    assert shipped.stat().st_size < 50_000
    with playing(executable) as game:
        heard = reports(game, 50)
    assert sum(report["return"] for report in heard) / len(heard) >= 249.0


def test_a_game_ends_with_whoever_reads_its_report(executable: Path) -> None:
    with playing(executable) as game:
        reports(game, 1)
        assert game.stdout is not None
        game.stdout.close()
        assert game.wait(DEADLINE_S) == 0


@pytest.mark.parametrize(
    ("policy", "expected"),
    [
        ("cart=/no/such/file", "policy cart: /no/such/file: cannot read /no/such/file"),
        ("cart", "policy cart: : cannot read"),
        ("hero=GRU", "policy hero: the game has no such policy; it has: cart"),
        (
            "cart=GRU",
            'gru.ludus.json: observation["observation"]: the policy was trained on float32 [3], '
            "the agent has float32 [4]",
        ),
        ("cart=BROKEN", "broken.ludus.json: layers: missing field"),
    ],
)
def test_a_wrong_policy_ends_the_game(
    executable: Path, tmp_path: Path, policy: str, expected: str
) -> None:
    broken = tmp_path / "broken.ludus.json"
    broken.write_text(model_path("gru").read_text().replace('"weight":', '"heft":'))
    named = policy.replace("GRU", str(model_path("gru"))).replace("BROKEN", str(broken))
    with playing(executable, f"--ludus-policy={named}") as game:
        out, error = game.communicate(timeout=DEADLINE_S)
    assert (game.returncode, out) == (1, "")
    assert expected.replace("layers: missing", "layers[0]: missing") in error
    assert "\nhint: " in error


def test_a_trainer_wins(executable: Path) -> None:
    with open_pool(executable, PoolConfig(num_worlds=2)) as pool:
        batches = pool.reset(0)
        for _ in range(30):
            batches = pool.step(zeros(pool))
        assert batches["cart"].active.all()


def test_people_may_watch_a_trainer(executable: Path) -> None:
    """A step of two ticks lasts as long as two ticks of the game, where it need not."""
    times: list[float] = []
    for is_real_time in (False, True):
        settings = PoolConfig(launch=LaunchOptions(is_real_time=is_real_time))
        with open_pool(executable, settings) as pool:
            pool.reset(0)
            began = time.monotonic()
            for _ in range(120):
                pool.step(zeros(pool))
            times.append(time.monotonic() - began)
    hurried, watched = times
    assert watched >= 119 * 2 / 60
    assert hurried < watched


# --- the parity test ----------------------------------------------------------------------------


def measure(policy: Policy, folder: Path, game: BevyGame) -> ParityReport:
    model = to_model(policy, policy.spec)
    path = folder / "policy.ludus.json"
    write_model(path, model)
    return measure_parity(policy, model, PolicyFiles(path), game, {})


@pytest.mark.parametrize(
    ("policy", "config"),
    [
        ("simple", PPOConfig(hidden_sizes=(64, 64))),
        ("mixed", PPOConfig(hidden_sizes=(16, 7), activation="elu", squash=True)),
        ("mixed", PPOConfig(hidden_sizes=(9,), memory_size=6, state_dependent_std=True)),
        ("mixed", PPOConfig(hidden_sizes=(9,), memory_size=5, frame_stack=3)),
        ("mixed", SACConfig(hidden_sizes=(16,), activation="silu", normalise_observation=False)),
        ("atari", PPOConfig(hidden_sizes=(16,), activation="relu")),
    ],
    ids=["simple", "mixed", "memory", "frames", "sac", "atari"],
)
def test_bevy_computes_the_same(
    policy: str, config: PolicyConfig, executable: Path, tmp_path: Path
) -> None:
    spec = {"simple": SIMPLE, "mixed": MIXED, "atari": ATARI}[policy]
    game = BevyGame(executable)
    report = measure(make_policy(spec, config, noise=0.01), tmp_path, game)
    require_parity(report)
    bevy = report.comparisons[-1]
    assert bevy.runtime == "Bevy"
    assert 0 < bevy.outputs <= 1e-4


def test_bevy_notices_an_altered_weight(executable: Path, tmp_path: Path) -> None:
    policy = make_policy(SIMPLE)
    model = to_model(policy, SIMPLE)
    model.layers[0].weight[0, 0] += 0.05
    path = tmp_path / "policy.ludus.json"
    write_model(path, model)
    report = measure_parity(policy, model, PolicyFiles(path), BevyGame(executable), {})
    assert not report.comparisons[-1].is_equal
    with pytest.raises(ParityError, match="policy hero: "):
        require_parity(report)


def test_a_file_that_bevy_refuses_is_an_error(
    executable: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def write_broken(folder: Path, *_: object) -> None:
        (folder / "request.json").write_text("{")

    monkeypatch.setattr(engines, "write_request", write_broken)
    with pytest.raises(EngineError, match="does not run in Bevy") as error:
        measure(make_policy(SIMPLE), tmp_path, BevyGame(executable))
    assert "--no-parity" in error.value.hint


def test_a_game_that_takes_too_long_is_ended(
    executable: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The real game, which somebody stops before it can begin."""
    stopped = tmp_path / "stopped"
    stopped.write_text(f'#!/bin/sh\nkill -STOP $$\nexec "{executable}" "$@"\n')
    stopped.chmod(0o755)
    monkeypatch.setattr(engines, "TIMEOUT_S", 0.5)
    with pytest.raises(EngineTimeout, match=r"did not test the policy within 0\.5 s"):
        measure(make_policy(SIMPLE), tmp_path, BevyGame(stopped))
    assert left_processes() == []
