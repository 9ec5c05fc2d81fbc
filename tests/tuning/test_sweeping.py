"""Whole sweeps: what they leave, how they go on after a kill, and how they fail."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path
from typing import Any

import pytest

import ludus
from ludus.algorithms.learners import make_learners
from ludus.cli.main import main
from ludus.errors import ConfigError, EngineStartError, RunError, SetupError
from ludus.runs.run_folder import RunFolder
from ludus.settings.train_config import TrainConfig
from ludus.training import loop
from ludus.tuning.sweeping import USUAL_SPACE, Trial
from tests.training.environments import register

register()
TARGET = "gym:CartPole-v1"
TWO_CHOICES = "gym:Identity-multi_discrete-v0"
SMALL: dict[str, Any] = {
    "num_worlds": 4, "num_engines": 1, "total_steps": 512, "seed": 5, "name": "sweep",
    "ppo": {"rollout_steps": 16, "hidden_sizes": [8]},
}  # fmt: skip
SPACE = {"ppo.learning_rate": "log:1e-4:1e-1", "ppo.activation": "tanh,relu"}


@pytest.mark.libraries
def test_a_sweep_leaves_the_best_settings_and_a_picture(tmp_path: Path) -> None:
    seen: list[int] = []

    def on_trial(trial: Trial) -> None:
        seen.append(trial.number)

    sweep = ludus.sweep(TARGET, SPACE, trials=4, runs=tmp_path, on_trial=on_trial, **SMALL)
    assert seen == [0, 1, 2, 3]
    assert sweep.trials[0].values == {"ppo.learning_rate": 1e-3, "ppo.activation": "tanh"}
    assert len({str(trial.values) for trial in sweep.trials}) == 4
    best = sweep.best
    assert best is not None
    assert best.score == max(
        trial.score for trial in sweep.trials if trial.score and trial.state == "complete"
    )
    written = tomllib.loads((sweep.path / "best.toml").read_text())
    assert written["ppo"] == {name.partition(".")[2]: value for name, value in best.values.items()}
    assert (sweep.path / "sweep.png").read_bytes().startswith(b"\x89PNG")
    config = json.loads((best.path / "config.json").read_bytes())
    assert config["ppo"]["learning_rate"] == best.values["ppo.learning_rate"]
    assert config["origins"]["ppo.learning_rate"] == f"trial {best.number}"
    own: dict[str, Any] = {**SMALL, "name": "best"}
    run = ludus.train(TARGET, config=sweep.path / "best.toml", runs=tmp_path, **own)
    assert run.agent_steps == 512


@pytest.mark.libraries
@pytest.mark.engine
@pytest.mark.parametrize(
    ("discount", "epochs"),
    [("0.9:0.999", "4:12"), ("0.98:0.99", "4:12"), ("0.9,0.99", "4,10")],
    ids=["in-the-space", "outside", "no-choice"],
)
def test_the_first_trial_has_the_settings_of_the_scene(
    tmp_path: Path, discount: str, epochs: str
) -> None:
    space = {"ppo.discount": discount, "ppo.epochs": epochs, "algorithm": "ppo,sac"}
    given: dict[str, Any] = {"num_worlds": 2, "num_engines": 1, "total_steps": 64, "seed": 5}
    (trial,) = ludus.sweep("pendulum", space, trials=1, runs=tmp_path, **given).trials
    assert trial.values == {"ppo.discount": 0.95, "ppo.epochs": 10, "algorithm": "ppo"}
    config = json.loads((trial.path / "config.json").read_bytes())
    origins = {name: of for name, of in config["origins"].items() if name.startswith("policies.")}
    assert set(origins.values()) == {"scene"}
    assert config["policies"]["pendulum"]["discount"] == 0.95


@pytest.mark.libraries
def test_a_target_return_counts_steps(tmp_path: Path) -> None:
    sweep = ludus.sweep(
        TARGET, SPACE, trials=2, runs=tmp_path, target_return=12.0, return_window=3, **SMALL
    )
    assert sweep.objective == "steps"
    reached = sweep.trials[0]
    assert reached.reached
    assert reached.score == json.loads((reached.path / "result.json").read_bytes())["agent_steps"]
    own: dict[str, Any] = {**SMALL, "name": "hard"}
    hard = ludus.sweep(TARGET, SPACE, trials=1, runs=tmp_path, target_return=400.0, **own)
    (missed,) = hard.trials
    assert missed.reached is False
    assert missed.score is not None
    assert 512 < missed.score <= 1024


@pytest.mark.libraries
def test_the_median_of_several_seeds_counts(tmp_path: Path) -> None:
    sweep = ludus.sweep(TARGET, SPACE, trials=2, seeds=3, runs=tmp_path, **SMALL)
    for trial in sweep.trials:
        runs = [trial.path, *(trial.path.with_name(f"{trial.path.name}-{n}") for n in (1, 2))]
        configs = [json.loads((run / "config.json").read_bytes()) for run in runs]
        assert [config["seed"] for config in configs] == [
            5 + 3 * trial.number + n for n in range(3)
        ]
        assert {config["ppo"]["learning_rate"] for config in configs} == {
            trial.values["ppo.learning_rate"]
        }
        returns = [ludus_metrics(run)[-1]["policies"]["agent"]["mean_return"] for run in runs]
        assert trial.score == sorted(returns)[1]


@pytest.mark.libraries
@pytest.mark.parametrize(("seeds", "cut_off"), [(1, "trial-001"), (2, "trial-000-1")])
def test_a_killed_sweep_goes_on_with_the_run_that_was_cut_off(
    tmp_path: Path, seeds: int, cut_off: str
) -> None:
    folder = tmp_path / "sweep"
    command = [
        sys.executable, "-m", "ludus", "sweep", TARGET, "--set", "ppo.learning_rate=log:1e-4:1e-1",
        "--trials", "9", "--seeds", str(seeds), "--total-steps", "20000",
        "--num-worlds", "4", "--num-engines", "1",
        "--checkpoint-every-s", "none", "--checkpoint-every-updates", "1",
        "--runs", str(tmp_path), "--name", "sweep",
    ]  # fmt: skip
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as process:
        run = folder / "trials" / cut_off
        deadline = time.monotonic() + 120
        while not len(list(run.glob("checkpoints/step-*"))) > 1:
            assert process.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.02)
        os.kill(process.pid, signal.SIGKILL)
    saved = max(int(path.name[5:]) for path in run.glob("checkpoints/step-*"))
    assert saved > 0
    sweep = ludus.sweep(resume=folder, trials=3 - seeds)
    assert [trial.path.name for trial in sweep.trials] == ["trial-000", "trial-001"][: 3 - seeds]
    assert len(list((folder / "trials" / "trial-000").glob("events.out.tfevents*"))) == 1
    assert len(list(run.glob("events.out.tfevents*"))) == 2 or saved >= 20000
    steps = [line["agent_steps"] for line in ludus_metrics(run)]
    assert steps == sorted(set(steps))
    assert steps[-1] >= 20000


@pytest.mark.libraries
@pytest.mark.parametrize(("seeds", "cut_off"), [(1, "trial-001"), (2, "trial-000-1")])
def test_a_run_that_was_cut_off_before_its_first_checkpoint_begins_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seeds: int, cut_off: str
) -> None:
    run = tmp_path / "sweep/trials" / cut_off
    output = run / "engine-logs/engine-0.log"

    def fail_once(config: TrainConfig, pool: Any, own: Any, **others: Any) -> Any:
        if config.name == cut_off and not run.with_name("failed").exists():
            output.parent.mkdir()
            output.write_text("what an engine printed")
            run.with_name("failed").touch()
            raise EngineStartError("it did not start")
        return make_learners(config, pool, own, **others)

    monkeypatch.setattr(loop, "make_learners", fail_once)
    with pytest.raises(EngineStartError):
        ludus.sweep(TARGET, SPACE, trials=3 - seeds, seeds=seeds, runs=tmp_path, **SMALL)
    with RunFolder(run).locked(), pytest.raises(RunError, match="trained by another process"):
        ludus.sweep(resume=tmp_path / "sweep", trials=3 - seeds)
    assert output.exists()
    sweep = ludus.sweep(resume=tmp_path / "sweep", trials=3 - seeds)
    assert [trial.path.name for trial in sweep.trials] == ["trial-000", "trial-001"][: 3 - seeds]
    assert {trial.state for trial in sweep.trials} == {"complete"}
    assert not output.exists()
    assert ludus_metrics(run)[-1]["agent_steps"] == 512


@pytest.mark.libraries
@pytest.mark.parametrize(
    ("space", "unfit", "message"),
    [
        (
            {"ppo.rollout_steps": "16,24"},
            {"ppo.rollout_steps": 24},
            "failed: ppo: rollout_steps must be a multiple of sequence_length (16)",
        ),
        (
            {"algorithm": "ppo,sac"},
            {"algorithm": "sac"},
            "failed: policy agent: sac needs continuous actions or one discrete choice",
        ),
    ],
    ids=["sequence", "algorithm"],
)
def test_a_proposal_that_does_not_fit_is_a_failed_trial(
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
    space: dict[str, str],
    unfit: dict[str, Any],
    message: str,
) -> None:
    own: dict[str, Any] = {
        **SMALL, "total_steps": 128, "ppo": {"rollout_steps": 16, "memory_size": 4},
    }  # fmt: skip
    sweep = ludus.sweep(TWO_CHOICES, space, trials=6, runs=tmp_path, **own)
    assert len(sweep.trials) == 6
    assert [trial.values for trial in sweep.trials if trial.state == "failed"]
    for trial in sweep.trials:
        assert trial.state == ("failed" if trial.values == unfit else "complete")
    assert message in caplog.text


@pytest.mark.libraries
def test_settings_that_do_not_fit_as_they_are_end_the_sweep(tmp_path: Path) -> None:
    own: dict[str, Any] = {**SMALL, "algorithm": "sac"}
    with pytest.raises(ConfigError, match="sac needs"):
        ludus.sweep(TWO_CHOICES, {"sac.discount": "0.9,0.95"}, runs=tmp_path, **own)


@pytest.mark.libraries
def test_what_is_no_fault_of_a_proposal_ends_the_sweep(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: Any) -> Any:
        raise ConfigError("the engine is gone")

    ludus.sweep(TARGET, SPACE, trials=1, runs=tmp_path, **SMALL)
    with monkeypatch.context() as patch, pytest.raises(ConfigError, match="the engine is gone"):
        patch.setattr(loop, "open_pool", refuse)
        ludus.sweep(resume=tmp_path / "sweep", trials=3)
    sweep = ludus.sweep(resume=tmp_path / "sweep", trials=3)
    assert {trial.state for trial in sweep.trials} == {"complete"}


def ludus_metrics(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (path / "metrics.jsonl").read_text().splitlines()]


@pytest.mark.libraries
def test_the_command_prints_a_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code = main([
        "sweep", TARGET, "--trials", "2", "--set", "ppo.epochs=1:4",
        "--set", "ppo.discount=0.9,0.99", "--total-steps", "256",
        "--num-worlds", "2", "--num-engines", "1", "--runs", str(tmp_path),
    ])  # fmt: skip
    printed = capsys.readouterr()
    assert code == 0, printed.err
    assert "trial 0 has the settings as they are" in printed.out
    assert "trial 1: " in printed.err
    (folder,) = tmp_path.glob("sweep-CartPole-v1-*")
    assert f"sweep: {folder}" in printed.out.replace("\n", "")


@pytest.mark.libraries
@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_the_usual_settings_vary_where_none_is_named(algorithm: str, tmp_path: Path) -> None:
    sweep = ludus.sweep(TARGET, trials=2, runs=tmp_path, algorithm=algorithm, **SMALL)
    assert set(sweep.trials[1].values) == set(USUAL_SPACE[algorithm])
    assert json.loads((sweep.path / "sweep.json").read_text())["space"] == USUAL_SPACE[algorithm]


@pytest.mark.libraries
@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"trials": 0}, "trials must be at least 1, not 0"),
        ({"objective": "steps"}, "the objective steps needs a target_return"),
        ({"total_steps": 0}, "total_steps must be at least 1"),
    ],
    ids=str,
)
def test_a_mistake_leaves_nothing(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    given: dict[str, Any] = {"space": SPACE, "trials": 1, "runs": tmp_path, **SMALL, **changes}
    with pytest.raises(ConfigError, match=message):
        ludus.sweep(TARGET, **given)
    assert not list(tmp_path.iterdir())


@pytest.mark.libraries
def test_what_is_no_sweep_cannot_be_resumed(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="cannot be resumed as a sweep"):
        ludus.sweep(resume=tmp_path)


def test_without_optuna_the_package_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "optuna", None)
    with pytest.raises(SetupError, match=r"optuna is not installed\nhint: pip install optuna"):
        ludus.sweep(TARGET, SPACE, runs=tmp_path, **SMALL)
