from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from ludus.cli import train as train_command
from ludus.cli.main import main
from ludus.errors import ConfigError
from ludus.settings.merging import merge, resolve
from ludus.settings.train_config import PPOConfig, SACConfig, TrainConfig
from ludus.spec import AgentSpec, DiscreteAction, ObservationEntry, PolicySpec
from ludus.training.figures import sparkline

TARGET = "gym:CartPole-v1"
SMALL = [
    "--num-worlds", "4", "--num-engines", "1", "--total-steps", "256", "--seed", "1",
    "--ppo.rollout-steps", "16", "--ppo.hidden-sizes", "8",
]  # fmt: skip


def policy(name: str = "hero", **settings: Any) -> PolicySpec:
    entry = ObservationEntry("o", "float32", (1,))
    agents = (AgentSpec(0, "a"),)
    return PolicySpec(name, (entry,), (DiscreteAction("a", 2),), agents, settings=settings)


def effective(arguments: list[str], *policies: PolicySpec) -> TrainConfig:
    command = train_command.parse(arguments)
    return resolve(command.layers, {policy.name: policy for policy in policies}).config


def test_layers_scene_file_command_line(tmp_path: Path) -> None:
    file = tmp_path / "settings.toml"
    file.write_text(
        "num_worlds = 5\nnum_engines = 1\n"
        "[ppo]\ndiscount = 0.5\nepochs = 3\ngae_lambda = 0.4\n"
        "[policies.hero]\ngae_lambda = 0.3\n"
    )
    hero = policy("hero", discount=0.1, learning_rate=0.2, clip_range=0.3)
    target = policy("target", discount=0.1)
    typed = ["x", "--config", str(file), "--num-engines", "4", "--ppo.epochs", "7"]
    config = effective([*typed, "--policies.target.discount", "0.6"], hero, target)
    assert (config.target, config.num_worlds, config.num_engines) == ("x", 5, 4)
    first, second = config.policies["hero"], config.policies["target"]
    assert isinstance(first, PPOConfig)
    assert isinstance(second, PPOConfig)
    assert (first.learning_rate, first.clip_range) == (0.2, 0.3)  # scene
    assert (first.discount, first.gae_lambda) == (0.5, 0.3)  # file, and its own table
    assert (second.gae_lambda, second.discount) == (0.4, 0.6)  # file; command line, one policy
    assert first.epochs == second.epochs == 7  # command line


def test_the_algorithm_of_one_policy_can_be_typed() -> None:
    hero, foe = policy("hero", clip_range=0.3), policy("my_foe", learning_rate=0.2)
    typed = ["x", "--policies.my-foe.algorithm", "sac", "--policies.my-foe.batch-size", "99"]
    config = effective([*typed, "--sac.hidden-sizes", "7"], hero, foe)
    first, second = config.policies["hero"], config.policies["my_foe"]
    assert isinstance(first, PPOConfig)
    assert isinstance(second, SACConfig)
    assert first.clip_range == 0.3
    assert (second.batch_size, second.learning_rate, second.hidden_sizes) == (99, 0.2, (7,))


def test_the_algorithm_of_all_policies_can_be_typed() -> None:
    config = effective(["x", "--algorithm=sac"], policy("hero", clip_range=0.3), policy("foe"))
    assert [of.algorithm for of in config.policies.values()] == ["sac", "sac"]


def test_none_is_written_as_in_files() -> None:
    config = effective(["x", "--checkpoint-every-s", "none", "--ppo.target-kl", "none"], policy())
    assert config.checkpoint_every_s is None


def test_a_typed_default_wins_over_the_scene() -> None:
    hero = policy("hero", learning_rate=0.2)
    assert effective(["x"], hero).policies["hero"].learning_rate == 0.2
    typed = effective(["x", "--ppo.learning-rate", "0.001"], hero)
    assert typed.policies["hero"].learning_rate == 0.001


def test_flags_are_checked_with_what_the_file_says(tmp_path: Path) -> None:
    file = tmp_path / "settings.toml"
    file.write_text("checkpoint_every_updates = 5\n[ppo]\nsequence_length = 10\n")
    typed = ["x", "--config", str(file), "--exact-resume", "--checkpoint-every-s", "none"]
    memory = ["--ppo.memory-size", "8", "--ppo.rollout-steps", "100", "--no-compile"]
    config = effective([*typed, *memory], policy())
    assert config.exact_resume
    with pytest.raises(ConfigError, match="command line: ppo: rollout_steps must be a multiple"):
        effective(["x", *memory], policy())


def test_explain_says_where_settings_come_from(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--num-worlds=4", "--ppo.learning-rate", "0.01", "--runs", str(tmp_path)]
    assert main(["train", TARGET, *arguments, "--explain"]) == 0
    rows = {line.split()[0]: line.split(maxsplit=2)[1:] for line in
            capsys.readouterr().out.splitlines()}  # fmt: skip
    assert rows["num_worlds"] == ["4", "command line"]
    assert rows["policies.agent.learning_rate"] == ["0.01", "command line"]
    assert rows["policies.agent.discount"] == ["0.99", "default"]
    assert rows["seed"][1] == "random"
    assert not list(tmp_path.iterdir())


def test_unknown_scene_setting_names_the_policy() -> None:
    with pytest.raises(ConfigError, match=r"policy hero .scene.: unknown setting lerning_rate"):
        effective(["x"], policy("hero", lerning_rate=1))


def test_a_policy_that_does_not_exist_is_a_wrong_flag() -> None:
    with pytest.raises(ConfigError, match="command line: there is no policy villain"):
        effective(["x", "--policies.villain.discount", "0.5"], policy("hero"))


@pytest.mark.parametrize(
    ("flag", "hint"),
    [
        ("--policies.hero.discont", "did you mean discount?"),
        ("--ppo.lr", "did you mean learning-rate?"),
        ("--sac.no_tau=3", "settings of --sac: algorithm, "),
    ],
)
def test_an_unknown_flag_of_a_group_suggests_another(flag: str, hint: str) -> None:
    with pytest.raises(ConfigError, match="unknown setting --") as info:
        effective(["x", flag, "0.5"], policy("hero"))
    assert info.value.hint.startswith(hint)


@pytest.mark.parametrize(
    ("arguments", "exit_code", "text"),
    [
        ([], 2, "no target was given"),
        (["gym:Nowhere-v0"], 2, "cannot make 'Nowhere-v0'"),
        ([TARGET, "--wrong"], 2, "--wrong"),
        ([TARGET, "--num-worlds", "0"], 2, "num_worlds must be at least 1"),
        ([TARGET, "--num-worlds", "many"], 2, "many"),
        ([TARGET, "--ppo.discount", "3"], 2, "discount must be from 0 to 1"),
        (
            [TARGET, "--config", "nowhere.toml"],
            2,
            "settings in nowhere.toml: No such file",
        ),
        ([TARGET, "--config", "nowhere.toml"], 2, "hint: a settings file is TOML"),
        (["--resume", "nowhere"], 5, "nowhere is not a run"),
    ],
)
def test_bad_input(
    arguments: list[str],
    exit_code: int,
    text: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["train", *arguments]) == exit_code
    captured = capsys.readouterr()
    assert text in captured.err
    assert "Traceback" not in captured.err
    assert captured.out == ""
    assert not list(tmp_path.glob("runs/*"))


@pytest.mark.slow
def test_train_evaluate_resume(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runs = str(tmp_path)
    assert main(["train", TARGET, *SMALL, "--runs", runs, "--name", "r", "--json"]) == 0
    captured = capsys.readouterr()
    result = json.loads(captured.out)
    run = result["run"]
    assert (result["agent_steps"], result["stop_reason"]) == (256, "total_steps")
    assert result["evaluation"]["agent"]["num_episodes"] == 20
    assert "mean return" in captured.err

    assert main(["evaluate", run, "--episodes", "3", "--json"]) == 0
    evaluation = json.loads(capsys.readouterr().out)
    assert len(evaluation["policies"]["agent"]["returns"]) == 3
    assert "share_reaching" not in evaluation["policies"]["agent"]

    assert main(["train", "--resume", run, "--total-steps", "512", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["agent_steps"] == 512
    saved = json.loads((Path(run) / "config.json").read_bytes())
    assert saved["policies"]["agent"]["hidden_sizes"] == [8]
    assert saved["origins"]["total_steps"] == "command line"
    assert saved["origins"]["policies.agent.hidden_sizes"] == f"run {run}"

    again = ["train", "--config", f"{run}/config.json", "--name", "s", "--json"]
    assert main(again) == 0
    assert json.loads(capsys.readouterr().out)["agent_steps"] == 512


def test_a_run_that_exists_is_not_overwritten(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "r").mkdir()
    assert main(["train", TARGET, *SMALL, "--runs", str(tmp_path), "--name", "r"]) == 5
    assert "exists already" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize(("signum", "exit_code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_saves_and_says_how_to_go_on(signum: int, exit_code: int, tmp_path: Path) -> None:
    arguments = [*SMALL, "--runs", str(tmp_path), "--name", "r", "--total-steps", "100000000"]
    child = subprocess.Popen(
        [sys.executable, "-u", "-m", "ludus.cli", "train", TARGET, *arguments],
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert child.stderr is not None
    lines: list[str] = []
    while not any("steps/s" in line for line in lines):
        lines.append(child.stderr.readline())
        assert lines[-1], lines
    child.send_signal(signum)
    out, error = child.communicate(timeout=60)
    assert child.returncode == exit_code
    assert out == ""
    assert f"ludus train --resume {tmp_path}/r" in error.splitlines()[-1]
    assert "Traceback" not in error
    assert main(["evaluate", str(tmp_path / "r"), "--episodes", "1", "--json"]) == 0


def test_saved_settings_are_those_of_the_run() -> None:
    command = train_command.parse(["x", "--seed", "3"])
    assert merge(command.layers) == TrainConfig("x", seed=3)


def test_a_sparkline_fits_its_width() -> None:
    assert sparkline([0, 1, 2, 3, 4, 5, 6, 7]) == "▁▂▃▄▅▆▇█"
    assert sparkline([3, 3]) == "▁▁"
    assert sparkline([]) == ""
    assert len(sparkline(list(range(1000)), width=24)) == 24
