"""What can be written as target and as settings, and what is said where it cannot."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces

import ludus
from ludus.cli.main import main
from ludus.errors import ConfigError, EngineStartError, LudusError, TargetError
from ludus.legacy.registry import BRIDGES, find_bridge
from ludus.target import LEGACY_PREFIXES
from tests.legacy.conftest import GODOT_GYM_API, GYMGODOT

SETTINGS = {"gymgodot:": GYMGODOT, "godot_gym_api:": GODOT_GYM_API}


def test_every_bridge_is_known_to_the_commands() -> None:
    assert sorted(bridge.prefix for bridge in BRIDGES) == sorted(LEGACY_PREFIXES)
    assert find_bridge("cartpole") is None
    assert find_bridge("godot3:cartpole") is None


@pytest.mark.parametrize(
    ("given", "what"),
    [
        ({"layout": "grid"}, "layout cannot be set"),
        ({"num_worlds": 2}, "num_worlds cannot be set"),
        ({"scene": "res://a.tscn", "ticks_per_step": 4}, "scene, ticks_per_step cannot be set"),
        ({"render_mode": "human"}, "launch cannot be set"),
        ({"wind": 1, "rain": 2}, "has no setting wind, rain"),
        ({"num_engines": 0}, "must be at least 1"),
        ({"max_episode_steps": 0}, "max_episode_steps must be at least 1 or none, not 0"),
        ({"step_timeout_s": 1.0, "action_space": "left"}, "action_space 'left' cannot be read"),
    ],
)
@pytest.mark.parametrize("prefix", SETTINGS)
def test_unusable_settings_are_refused(prefix: str, given: dict[str, Any], what: str) -> None:
    settings = {**SETTINGS[prefix], **given}
    with pytest.raises(ConfigError, match=what) as caught:
        ludus.make_vec(f"{prefix}127.0.0.1:1", **settings)
    if "wind" in given:
        assert "it has action_space, observation_space" in caught.value.hint


@pytest.mark.parametrize("prefix", SETTINGS)
def test_spaces_must_be_declared(prefix: str) -> None:
    with pytest.raises(ConfigError, match=r"action_space, observation_space.* must be given") as no:
        ludus.make(f"{prefix}nowhere")
    assert f"ludus.make('{prefix}PATH', action_space=…)" in no.value.hint
    assert '--action-space "Discrete(2)"' in no.value.hint


@pytest.mark.parametrize("address", ["nowhere", "", "127.0.0.1:65536", "127.0.0.1:"])
@pytest.mark.parametrize("prefix", SETTINGS)
def test_missing_address_is_refused(prefix: str, address: str) -> None:
    with pytest.raises(TargetError, match="no project and no scene"):
        ludus.make(prefix + address, **SETTINGS[prefix])


def test_folder_without_a_project_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TargetError, match=r"project\.godot"):
        ludus.make(f"gymgodot:{tmp_path}", **GYMGODOT)
    (tmp_path / "notes.txt").touch()
    with pytest.raises(TargetError, match=r"notes\.txt"):
        ludus.make(f"godot_gym_api:{tmp_path}/notes.txt", **GODOT_GYM_API)


def test_games_cannot_share_a_port(tmp_path: Path) -> None:
    own = {name: value for name, value in GODOT_GYM_API.items() if name != "engine_address"}
    for target in ("127.0.0.1:9090", str(tmp_path)):
        with pytest.raises(ConfigError, match="2 games cannot share one port") as caught:
            ludus.make_vec(f"godot_gym_api:{target}", num_engines=2, **own)
        assert "port 0 takes a free one" in caught.value.hint
    choices: list[dict[str, Any]] = [GYMGODOT, {**GYMGODOT, "exeCmd": "true"}]
    for settings in choices:
        with pytest.raises(ConfigError, match="2 games cannot share one port"):
            ludus.make_vec("gymgodot:127.0.0.1:8000", num_engines=2, **settings)


def test_two_ways_to_start_a_game_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"both .* and exeCmd are given"):
        ludus.make(f"gymgodot:{tmp_path}", exeCmd="true", **GYMGODOT)
    with pytest.raises(ConfigError, match="both target and command are given"):
        ludus.make(f"godot_gym_api:{tmp_path}", command="true", **GODOT_GYM_API)
    with pytest.raises(ConfigError, match="two addresses are given"):
        ludus.make("godot_gym_api:127.0.0.1:9090", **GODOT_GYM_API)


def test_other_machines_are_kept_out() -> None:
    with pytest.raises(ConfigError, match="lets other machines connect"):
        ludus.make("gymgodot:0.0.0.0:8000", **GYMGODOT)


@pytest.mark.slow
def test_address_without_a_game_times_out() -> None:
    own = {name: value for name, value in GODOT_GYM_API.items() if name != "engine_address"}
    with pytest.raises(EngineStartError, match=r"no game listened at 127\.0\.0\.1:1 within 0\.5 s"):
        ludus.make("godot_gym_api:127.0.0.1:1", start_timeout_s=0.5, **own)
    with pytest.raises(EngineStartError, match=r"no game connected within 0\.5 s at 127\.0\.0\.1"):
        ludus.make("gymgodot:127.0.0.1:0", start_timeout_s=0.5, **GYMGODOT)


def test_settings_of_bridges_are_refused_elsewhere() -> None:
    with pytest.raises(LudusError, match="unexpected keyword argument 'action_space'"):
        ludus.make("cartpole", action_space=spaces.Discrete(2))
    config = ludus.PoolConfig(bridge={"action_space": spaces.Box(-1.0, 1.0, (1,), np.float32)})
    with pytest.raises(ConfigError, match="action_space is a setting of legacy bridges"):
        ludus.open_pool("cartpole", config)


@pytest.mark.parametrize(
    ("command", "hint"),
    [
        ("train", '--action-space "Discrete(2)"'),
        ("check", '--action-space "Discrete(2)"'),
        ("evaluate --random", '--action-space "Discrete(2)"'),
        ("play --headless --random", "move the game to the add-on"),
        ("bench", "move the game to the add-on"),
    ],
)
@pytest.mark.parametrize("prefix", SETTINGS)
def test_commands_say_what_is_missing(
    prefix: str,
    command: str,
    hint: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main([*command.split(), f"{prefix}127.0.0.1:1"]) == 2
    assert hint in capsys.readouterr().err
    assert list(tmp_path.rglob("*")) in ([], [tmp_path / "runs"])
