"""``ludus.train``: settings as the command has them, callbacks, what a run can do next."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
from torch import Tensor, nn

import ludus
from ludus import Episode, PPOConfig, Run, Training
from ludus.cli import train as train_command
from ludus.errors import CheckpointError, ConfigError, RunError, UsageError
from ludus.runs.run_folder import RunFolder
from ludus.runs.run_list import list_runs
from ludus.settings.merging import merge

TARGET = "gym:Identity-discrete-v0"
SMALL: dict[str, Any] = {
    "num_worlds": 4, "num_engines": 1, "seed": 7, "total_steps": 320, "evaluation_episodes": 0,
    "ppo": {"rollout_steps": 8, "minibatch_size": 64, "hidden_sizes": [16]}, "name": "run",
}  # fmt: skip


@pytest.fixture
def train_small(tmp_path: Path) -> Any:
    def train(**settings: Any) -> Run:
        return ludus.train(TARGET, runs=tmp_path, **{**SMALL, **settings})

    return train


def test_settings_are_those_of_the_command(train_small: Any) -> None:
    run = train_small(policies={"agent": {"entropy_coefficient": 0.02}})
    flags = [
        TARGET, "--num-worlds", "4", "--num-engines", "1", "--seed", "7", "--total-steps", "320",
        "--evaluation-episodes", "0", "--ppo.rollout-steps", "8", "--ppo.minibatch-size", "64",
        "--ppo.hidden-sizes", "16", "--name", "run", "--runs", str(run.path.parent),
        "--policies.agent.entropy-coefficient", "0.02",
    ]  # fmt: skip
    typed = merge(train_command.parse(flags).layers)
    config = RunFolder(run.path).read_config()
    own = config.policies["agent"]
    assert isinstance(own, PPOConfig)
    assert own.entropy_coefficient == 0.02
    assert asdict(typed) == {**asdict(config), "policies": {}}


def test_structs_and_dictionaries_are_the_same_settings(train_small: Any) -> None:
    given = PPOConfig(rollout_steps=8, minibatch_size=64, hidden_sizes=(16,))
    one = train_small(name="one")
    two = train_small(name="two", ppo=given)
    first, second = (RunFolder(run.path).read_config().policies for run in (one, two))
    assert first == second


MISTAKES: list[tuple[dict[str, Any], str]] = [
    ({"totl_steps": 3}, "unknown setting totl_steps"),
    ({"lerning_rate": 3}, "did you mean ppo.learning_rate"),
    ({"total_steps": "many"}, "total_steps must be a whole number, not 'many'"),
    ({"ppo": {"learning_rate": -1.0}}, "learning_rate must be above 0"),
    ({"ppo": 3}, "ppo must hold settings by name, not 3"),
    ({"policies": {"hero": {}}}, "there is no policy hero"),
    ({"policies": 3}, "policies must hold settings by name, not 3"),
    ({"networks": {"hero": nn.Identity}}, "there is no policy 'hero'"),
    ({"pool": 3}, "pool must be what ludus.open_pool returns, not int"),
    ({"learners": {"agent": lambda *_: 3}}, "int, lacks act, begin"),  # pyright: ignore
    ({"networks": {"agent": lambda _: 3}}, "must be a torch.nn.Module, not int"),  # pyright: ignore
]


# The settings make no names: functions have addresses, which differ between pytest's processes.
@pytest.mark.parametrize(
    ("settings", "message"), MISTAKES, ids=[message for _, message in MISTAKES]
)
def test_a_mistake_is_one_clear_error(
    train_small: Any, tmp_path: Path, settings: dict[str, Any], message: str
) -> None:
    with pytest.raises(UsageError, match=message):
        train_small(**settings)
    assert not (tmp_path / "run").exists()


def test_a_run_knows_its_metrics_and_can_be_evaluated_and_exported(train_small: Any) -> None:
    run = train_small(evaluation_episodes=4)
    assert [line["agent_steps"] for line in run.metrics] == list(range(32, 321, 32))
    assert run.evaluation["agent"].num_episodes == 4
    assert run.evaluate(6, num_worlds=2)["agent"].num_episodes == 6
    files = run.export(parity=False)
    assert files == {"agent": run.path / "agent.ludus.json"}


def test_a_resumed_run_keeps_its_settings(train_small: Any) -> None:
    run = train_small()
    again = ludus.train(resume=run.path, total_steps=640)
    assert again.path == run.path
    config = RunFolder(run.path).read_config()
    assert (config.total_steps, config.seed, config.num_worlds) == (640, 7, 4)
    assert len(again.metrics) == 20


def test_updates_are_reported_after_their_metrics_are_written(train_small: Any) -> None:
    seen: list[tuple[int, int]] = []

    def on_update(training: Training) -> None:
        assert training.progress is not None
        lines = training.folder.metrics.read_text().splitlines()
        seen.append((training.progress.agent_steps, len(lines)))

    train_small(on_update=on_update)
    assert seen == [(32 * number, number) for number in range(1, 11)]


def test_every_episode_is_reported_once(train_small: Any) -> None:
    episodes: list[Episode] = []

    def on_episode(_: Training, episode: Episode) -> None:
        episodes.append(episode)

    run = train_small(on_episode=on_episode)
    assert [episode.number for episode in episodes] == list(range(1, 41))
    assert {episode.length for episode in episodes} == {8}
    lines = run.metrics
    assert lines[-1]["policies"]["agent"]["episodes"] == len(episodes)
    mean = sum(episode.episode_return for episode in episodes) / len(episodes)
    assert lines[-1]["policies"]["agent"]["mean_return"] == pytest.approx(mean)


@pytest.mark.parametrize("hook", ["on_update", "on_episode"])
def test_a_callback_stops_the_run_with_its_evaluation(train_small: Any, hook: str) -> None:
    def stop(training: Training, *_: Any) -> None:
        training.stop()

    run = train_small(evaluation_episodes=2, **{hook: stop})
    assert (run.stop_reason, run.evaluation["agent"].num_episodes) == ("stopped", 2)
    assert run.agent_steps == 32
    assert list_runs(run.path)[0].state == "stopped"


def test_a_callback_changes_settings_that_the_run_records(train_small: Any) -> None:
    def on_update(training: Training) -> None:
        assert training.progress is not None
        if training.progress.agent_steps == 96:
            training.change(ppo={"learning_rate": 1e-5}, total_steps=192)
            training.change(policies={"agent": {"learning_rate_schedule": "constant"}})
        if training.progress.agent_steps == 160:
            training.change(policies={"agent": {"mode": "frozen"}})

    run = train_small(on_update=on_update)
    lines = [line["policies"]["agent"] for line in run.metrics]
    assert run.agent_steps >= 192
    assert [line.get("learning_rate") for line in lines[3:5]] == [1e-5, 1e-5]
    assert [line["is_learning"] for line in lines[:6]] == [1, 1, 1, 1, 1, 0]
    saved = json.loads((run.path / "config.json").read_bytes())
    assert saved["policies"]["agent"]["learning_rate"] == 1e-5
    assert saved["origins"]["policies.agent.learning_rate"] == "callback"
    assert saved["origins"]["seed"] == "Python"


def test_a_mode_that_a_callback_changes_lasts_over_the_phases(train_small: Any) -> None:
    def on_update(training: Training) -> None:
        if training.progress is not None and training.progress.agent_steps == 32:
            training.change(policies={"agent": {"mode": "frozen"}})

    run = train_small(on_update=on_update, schedule=[{"updates": 2}, {"updates": 2}])
    assert {line["policies"]["agent"]["is_learning"] for line in run.metrics[1:]} == {0}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"ppo": {"hidden_sizes": [8]}}, "policy agent: hidden_sizes cannot change"),
        ({"seed": 8}, "seed cannot change while a run goes on"),
        ({"ppo": {"learning_rate": 0.0}}, "learning_rate must be above 0"),
        ({"algorithm": "sac"}, "cannot change while a run goes on"),
    ],
    ids=str,
)
def test_what_cannot_change_ends_the_run_with_an_error(
    train_small: Any, change: dict[str, Any], message: str
) -> None:
    def on_update(training: Training) -> None:
        training.change(**change)

    with pytest.raises(ConfigError, match=message):
        train_small(on_update=on_update)


@pytest.mark.parametrize("hook", ["on_update", "on_episode"])
def test_an_exception_of_a_callback_leaves_a_failed_run_that_can_go_on(
    train_small: Any, tmp_path: Path, hook: str
) -> None:
    def fail(*_: Any) -> None:
        raise KeyError("mine")

    with pytest.raises(KeyError, match="mine"):
        train_small(**{hook: fail})
    (summary,) = list_runs(tmp_path)
    assert (summary.state, summary.agent_steps) == ("failed", 32)
    result = json.loads((tmp_path / "run" / "result.json").read_bytes())
    assert result["error"] == "KeyError: 'mine'"
    assert ludus.train(resume=tmp_path / "run").agent_steps == 320


def test_progress_is_shown_where_it_is_asked_for(
    train_small: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    train_small(name="quiet")
    assert capsys.readouterr().err == ""
    train_small(name="loud", progress=True)
    assert "training gym:Identity-discrete-v0 into" in capsys.readouterr().err


class Gate(nn.Module):
    """No chain of layers, so that no .ludus.json can hold it."""

    def __init__(self, spec: Any) -> None:
        super().__init__()
        self.gate = nn.Linear(sum(entry.size for entry in spec.observation), 8)
        self.value = nn.Linear(self.gate.in_features, 8)

    def forward(self, observation: dict[str, Tensor]) -> Tensor:
        x = observation["observation"]
        return self.gate(x).sigmoid() * self.value(x)


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_a_network_of_a_script_learns_and_runs_in_onnx(train_small: Any, algorithm: str) -> None:
    sac = {"hidden_sizes": [16], "learning_starts": 32, "report_steps": 8, "batch_size": 32}
    run = train_small(networks={"agent": Gate}, algorithm=algorithm, sac=sac)
    assert run.evaluate(2)["agent"].num_episodes == 2
    files = run.export()
    assert files["agent"].name == "agent.onnx"
    policy = ludus.load_policy(run.path, networks={"agent": Gate})
    onnx = ludus.load_policy(files["agent"])
    batch = [policy.observation_space.sample() for _ in range(5)]
    assert policy.act(batch).tolist() == onnx.act(batch).tolist()
    again = ludus.train(resume=run.path, total_steps=640, networks={"agent": Gate})
    assert again.agent_steps == 640


def test_a_network_that_no_file_describes_is_asked_for(train_small: Any) -> None:
    run = train_small(networks={"agent": Gate})
    with pytest.raises(CheckpointError, match="a network that a script made"):
        ludus.load_policy(run.path)
    with pytest.raises(RunError, match=r"which .ludus.json cannot hold"):
        run.export(run.path / "agent.ludus.json")


def test_a_chain_of_layers_goes_into_the_game(train_small: Any) -> None:
    def make(spec: Any) -> nn.Module:
        return nn.Sequential(nn.Linear(4, 12), nn.SiLU(), nn.Linear(12, 8), nn.ReLU())

    run = train_small(networks={"agent": make}, ppo={**SMALL["ppo"], "hidden_sizes": []})
    files = run.export(parity=False)
    assert files["agent"].name == "agent.ludus.json"
    network = ludus.load_policy(run.path, networks={"agent": make})
    in_game = ludus.load_policy(files["agent"])
    batch = [network.observation_space.sample() for _ in range(20)]
    assert network.act(batch).tolist() == in_game.act(batch).tolist()


def test_a_network_that_returns_no_rows_is_an_error(train_small: Any) -> None:
    def make(_: Any) -> nn.Module:
        return nn.Sequential(nn.Unflatten(1, (2, 2)))

    with pytest.raises(UsageError, match=r"float32\[2, features\] here, not \[2, 2, 2\]"):
        train_small(networks={"agent": make})
