"""Settings of bridges as flags: spaces as texts; a game trained, evaluated and recorded."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces

from ludus.cli.bridge_flags import take_bridge_flags
from ludus.cli.main import main
from ludus.errors import ConfigError
from ludus.legacy.registry import find_bridge, read_settings
from ludus.legacy.setting_text import parse_space

MOVE = ["--action-space", "Box(-1, 1, (1,))"]
SEE = ["--observation-space=Box(-inf, inf, (3,))"]
ONE = ["--num-worlds", "1", "--num-engines", "1"]


@pytest.mark.parametrize(
    ("text", "space"),
    [
        ("Discrete(2)", spaces.Discrete(2)),
        (" gymnasium.spaces.Discrete(3, start=-1) ", spaces.Discrete(3, start=-1)),
        ("Box(-2, 2, (1,))", spaces.Box(-2, 2, (1,))),
        ("Box(0, 255, (4, 4, 3), uint8)", spaces.Box(0, 255, (4, 4, 3), np.uint8)),
        ("Box(low=-1, high=1, shape=(), dtype='float64')", spaces.Box(-1, 1, (), np.float64)),
        (
            "Box([-40, -np.inf, -pi/8], [40, inf, math.pi/8])",
            spaces.Box(
                np.array([-40, -np.inf, -np.pi / 8], np.float32),
                np.array([40, np.inf, np.pi / 8], np.float32),
            ),
        ),
        ("MultiDiscrete([2, 1 + 2])", spaces.MultiDiscrete([2, 3])),
        ("MultiBinary(4)", spaces.MultiBinary(4)),
        (
            "Dict({'place': Box(-inf, inf, ()), 'rays': Box(0, inf, (2,))})",
            spaces.Dict(place=spaces.Box(-np.inf, np.inf, ()), rays=spaces.Box(0, np.inf, (2,))),
        ),
        ("Dict(place=Discrete(2))", spaces.Dict(place=spaces.Discrete(2))),
    ],
)  # fmt: skip
def test_spaces_are_read_as_python_has_them(text: str, space: spaces.Space[Any]) -> None:
    assert parse_space("action_space", text) == space


@pytest.mark.parametrize("space", [spaces.Discrete(2), spaces.Box(-2, 2, (1,))])
def test_what_a_space_prints_is_read_again(space: spaces.Space[Any]) -> None:
    assert parse_space("action_space", repr(space)) == space


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("left", "left is unknown"),
        ("", "cannot be read"),
        ("2", "must be one of Discrete, Box"),
        ("Box(-2, 2, (1,)", "was never closed"),
        ("Box(-2, 2, (1,), float32, 3)", "Box takes low, high, shape and dtype"),
        ("Box(-2)", "cannot be read: 'high'"),
        ("Box(0, 255, (4,), 'float13')", "float13"),
        ("Discrete(-1)", "cannot be read"),
        ("Discrete(1 / 0)", "division by zero"),
        ("Discrete([1] * 9999999)", r"\[1\] is not a number"),
        ("Tuple((Discrete(2),))", "there is no space Tuple"),
        ("__import__('os').system('true')", "has no place|there is no space system"),
        ("Discrete(open('/etc/passwd'))", "there is no space open"),
        ("(lambda: 1)()", "there is no space"),
        ("Discrete(2).n", "has no place in a space"),
        ("9**9**9", "has no place in a space"),
        ("(" * 5000, "cannot be read"),
        ("[" * 20000, "more than 10000 characters"),
    ],
)
def test_other_texts_are_refused_and_never_run(text: str, what: str) -> None:
    with pytest.raises(ConfigError, match=what) as caught:
        parse_space("action_space", text)
    assert caught.value.message.startswith("action_space ")
    assert "Discrete(2)" in caught.value.hint


def test_flags_of_a_bridge_are_taken_out() -> None:
    rest, found = take_bridge_flags(
        ["gymgodot:game", *MOVE, *SEE, "--window-render", "--exeCmd", "a b", "--seed", "1"]
    )
    assert rest == ["gymgodot:game", "--seed", "1", *ONE]
    assert found == {
        "action_space": "Box(-1, 1, (1,))",
        "observation_space": "Box(-inf, inf, (3,))",
        "window_render": True,
        "exeCmd": "a b",
    }


def test_other_targets_keep_their_flags() -> None:
    typed = ["cartpole", *MOVE]
    assert take_bridge_flags(typed) == (typed, {})
    typed = ["--target=http://127.0.0.1:1", "--num_worlds=2", "--num-engines", "3"]
    assert take_bridge_flags(typed) == (typed, {})


def test_texts_become_what_the_bridge_needs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "rules_of_a_test.py").write_text(
        "def get_reward(state):\n    return 1.0\n\ndef is_far(state):\n    return False\n"
    )
    monkeypatch.chdir(tmp_path)
    bridge = find_bridge("godot_gym_api:")
    assert bridge is not None
    typed = {
        "action_space": "Discrete(2)",
        "observation_space": "Dict(place=Box(-inf, inf, ()))",
        "get_reward": "rules_of_a_test",
        "is_terminated": "rules_of_a_test:is_far",
        "engine_address": "127.0.0.1:0",
        "configuration": '{"environment": {"repeat_action": 2}}',
        "frames_per_second": "30",
        "step_timeout_s": "5",
        "is_windowed": "true",
    }
    read = read_settings(bridge, typed)
    assert read.pop("get_reward")(None) == 1.0
    assert read.pop("is_terminated")(None) is False
    assert read == {
        "action_space": spaces.Discrete(2),
        "observation_space": spaces.Dict(place=spaces.Box(-np.inf, np.inf, ())),
        "engine_address": ("127.0.0.1", 0),
        "configuration": {"environment": {"repeat_action": 2}},
        "frames_per_second": 30,
        "step_timeout_s": 5.0,
        "is_windowed": True,
    }


@pytest.mark.parametrize(
    ("flags", "what"),
    [
        ("--engine-address 9090", "engine_address is '9090', expected HOST:PORT"),
        ("--get-reward nowhere_to_be_found:f", "there is no module 'nowhere_to_be_found'"),
        ("--get-reward json:nothing", "module json has no nothing"),
        ("--frames-per-second fast", "frames_per_second must be a whole number, not 'fast'"),
        ("--configuration 3", "configuration must be a dictionary, not '3'"),
        ("--wind 3", "Unrecognized options: --wind"),
    ],
)
def test_unreadable_flags_are_named(
    flags: str, what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    rules = ["--get-reward", "json:loads", "--is-terminated", "json:loads"]
    typed = ["check", "godot_gym_api:127.0.0.1:1", *MOVE, *SEE, *rules, *flags.split()]
    assert main(typed) == 2
    shown = capsys.readouterr()
    assert what in " ".join((shown.err + shown.out).split())


@pytest.mark.engine
def test_gymgodot_project_trains_without_a_module(
    projects: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    target = f"gymgodot:{projects['gymgodot']}"
    assert main(["check", target, *MOVE, *SEE, "--steps", "40", "--timing-s", "0.1"]) == 0
    sizes = ["--total-steps", "64", "--ppo.rollout-steps", "32", "--ppo.minibatch-size", "32"]
    limits = ["--max-episode-steps", "10", "--evaluation-episodes", "0", "--name", "walk"]
    assert main(["train", target, *MOVE, *SEE, *sizes, *limits, "--step-timeout-s", "30"]) == 0
    saved = json.loads((tmp_path / "runs/walk/config.json").read_text())
    assert saved["num_worlds"] == 1
    assert saved["bridge"] == {
        "action_space": "Box(-1, 1, (1,))",
        "observation_space": "Box(-inf, inf, (3,))",
        "step_timeout_s": "30",
    }
    capsys.readouterr()
    assert main(["evaluate", "runs/walk", "--episodes", "1", "--json"]) == 0
    length = json.loads(capsys.readouterr().out)["policies"]["agent"]["mean_length"]
    assert 0 < length <= 10


@pytest.mark.engine
@pytest.mark.screen
def test_gymgodot_project_is_filmed(
    projects: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    typed = ["record", f"gymgodot:{projects['gymgodot']}", *MOVE, *SEE, "--random"]
    limits = ["--max-episode-steps", "5", "--episodes", "1", "--out", "film.mp4"]
    assert main([*typed, *limits]) == 0
    assert "agent: 1 episodes" in capsys.readouterr().out
    assert (tmp_path / "film.mp4").stat().st_size > 0
    typed[1] = f"godot_gym_api:{projects['json']}"
    rules = ["--get-reward", "json:loads", "--is-terminated", "json:loads"]
    assert main([*typed, *rules, *limits]) == 2
    assert "has no pictures of the screen" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        (["gdrl:{game}", "--random", "--num-worlds", "2"], "num_worlds cannot be set"),
        (["gymgodot:{game}", *MOVE, *SEE, "--random", "--layout", "grid"], "layout cannot be set"),
        (["gym:CartPole-v1", "--random", "--ticks-per-step", "2"], "ticks_per_step cannot be set"),
        (["gym:CartPole-v1", "--random", "--num-worlds", "2"], "shows one environment, not 2"),
    ],
)
def test_films_refuse_what_means_nothing_to_the_game(
    typed: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "project.godot").touch()
    out = tmp_path / "film.mp4"
    filled = [word.format(game=tmp_path) for word in typed]
    assert main(["record", *filled, "--out", str(out)]) == 2
    assert said in capsys.readouterr().err
    assert not out.exists()
