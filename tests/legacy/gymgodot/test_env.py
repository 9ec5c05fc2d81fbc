"""The environment against a program that speaks GymGodot's wire."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import TimeLimit
from PIL import Image

from ludus.errors import ActionError, ConfigError, SequenceError, UsageError
from ludus.legacy.godot_gym_api.connecting import free_port
from tests.legacy.gymgodot.conftest import ROOT, Opener, fake_command, game_of, left_processes
from tests.legacy.gymgodot.fake_game import CONVERSATION

LIMIT = np.array([40.0, np.inf, np.pi / 8, np.inf], np.float32)
CARTPOLE: dict[str, Any] = {
    "action_space": gymnasium.spaces.Discrete(2),
    "observation_space": gymnasium.spaces.Box(-LIMIT, LIMIT),
}
HALF = np.array([0.5], np.float32)


def test_recorded_conversation_is_replayed(opener: Opener, tmp_path: Path) -> None:
    """GymGodot's own cart-pole under Godot 3.6.2 said this; its requests are the same."""
    Image.new("RGB", (4, 4)).save(tmp_path / "0.png")
    env = opener.fake("replay", **CARTPOLE, renderPath=f"{tmp_path}/")
    episode = 0
    for line in CONVERSATION.read_text().splitlines():
        request, answer = (json.loads(text) for text in json.loads(line))
        if request["cmd"] == "reset":
            observation, info = env.reset()
            assert observation.tolist() == answer["init_observation"] == [0, 0, 0, 0]
            assert info == {}
            episode += 1
        elif request["cmd"] == "render":
            assert env.render() is None
        else:
            observation, reward, terminated, truncated, info = env.step(request["action"][0])
            assert observation.dtype == np.float32
            assert observation == pytest.approx(answer["observation"], abs=1e-6)
            assert (reward, terminated, truncated) == (1.0, answer["done"], False)
    assert episode == 3
    env.close()
    assert "ERROR" not in " ".join(left_processes())


@pytest.mark.parametrize("name", ["ludus/GymGodot-v0", "server-v0"])
def test_both_ids_take_the_old_arguments(opener: Opener, name: str, tmp_path: Path) -> None:
    env = gymnasium.make(
        name,
        serverIP="127.0.0.1",
        serverPort="0",
        exeCmd=fake_command("walk"),
        action_space=gymnasium.spaces.Box(-1.0, 1.0, (1,)),
        observation_space=gymnasium.spaces.Box(-9.0, 9.0, (2,)),
        window_render=False,
        renderPath=f"{tmp_path}/",
        proc_mode="thread",
        env_fps=60,
    )
    try:
        env.reset(seed=3)
        observation, reward, *_ = env.step(HALF)
        assert (observation.tolist(), reward) == ([0.5, 1.0], 0.5)
    finally:
        env.close()
    env.close()


def test_gym_021_returns_what_the_notebook_got(tmp_path: Path) -> None:
    settings: dict[str, Any] = {
        "serverPort": 0,
        "exeCmd": fake_command("walk"),
        "action_space": gymnasium.spaces.Box(-1.0, 1.0, (1,)),
        "observation_space": gymnasium.spaces.Box(-9.0, 9.0, (2,), np.float64),
        "renderPath": f"{tmp_path}/",
    }
    env: Any = gymnasium.make("server-v0", compatibility="gym-0.21", **settings)
    try:
        env.seed(3)
        observation, reward, done, info = env.step(HALF)  # before the first reset, as there
        assert (observation.dtype, observation.tolist()) == (np.float32, [0.5, 1.0])
        assert (reward, done, info) == (0.5, False, {})
        first = env.reset()
        assert (first.dtype, first.tolist()) == (np.float32, [0.0, 0.0])
        assert [env.step(HALF)[2] for _ in range(7)] == [False] * 6 + [True]
        assert env.step(HALF)[2]  # and after the end
        assert env.render(mode="human") is None
        assert (tmp_path / "0.png").is_file()
    finally:
        env.close()
    with pytest.raises(ConfigError, match=r"compatibility is 'gym-0\.26', expected None"):
        gymnasium.make("server-v0", compatibility="gym-0.26", **settings)


def test_gymnasium_checker_passes(opener: Opener) -> None:
    space = gymnasium.spaces.Box(-100.0, 100.0, (2,))
    env = opener.fake("walk", render_mode="rgb_array", observation_space=space)
    check_env(env.unwrapped, skip_close_check=True)


def test_an_episode_ends_and_the_next_begins(opener: Opener) -> None:
    env = opener.fake("walk").unwrapped
    with pytest.raises(SequenceError, match="outside an episode"):
        env.step(HALF)
    for _ in range(2):
        env.reset()
        ends = [env.step(HALF)[2] for _ in range(7)]
        assert ends == [False] * 6 + [True]
        with pytest.raises(SequenceError, match="outside an episode"):
            env.step(HALF)
    limited = TimeLimit(env, 2)
    limited.reset()
    assert [limited.step(HALF)[3] for _ in range(2)] == [False, True]


def test_frames_are_saved_and_numbered(opener: Opener, tmp_path: Path) -> None:
    env = opener.fake("walk", renderPath=f"{tmp_path}/a frame ")
    for _ in range(2):
        env.reset()
        for _ in range(3):
            assert env.render() is None
    names = sorted(file.name for file in tmp_path.iterdir())
    assert names == ["a frame 0.png", "a frame 1.png", "a frame 2.png"]


def test_frames_are_returned(opener: Opener, tmp_path: Path) -> None:
    env = opener.fake("walk", render_mode="rgb_array", renderPath=f"{tmp_path}/")
    for _ in range(2):
        env.reset()
        for number in range(2):
            frame: Any = env.render()
            assert (frame.shape, frame.dtype) == ((2, 3, 3), np.uint8)
            assert frame[0, 0].tolist() == [10, 20, number]
    assert len(list(tmp_path.iterdir())) == 2


def test_temporary_frames_are_deleted(opener: Opener) -> None:
    env = opener.fake("walk", render_mode="rgb_array")
    folder = Path(game_of(env).frames.render_path)
    env.reset()
    assert env.render() is not None
    assert list(folder.iterdir()) == []
    env.close()
    assert not folder.exists()


def test_environments_take_different_ports(opener: Opener) -> None:
    envs = [opener.fake("walk") for _ in range(3)]
    ports = {game_of(env).game.port for env in envs}
    assert len(ports) == 3
    for env in envs:
        env.reset()
    for count, env in enumerate(envs):
        for _ in range(count):
            env.step(HALF)
    assert [env.step(HALF)[0][1] for env in envs] == [1.0, 2.0, 3.0]


def test_make_vec_starts_one_game_each(opener: Opener) -> None:
    envs = gymnasium.make_vec(
        "server-v0",
        num_envs=2,
        serverPort=0,
        exeCmd=fake_command("walk"),
        action_space=gymnasium.spaces.Box(-1.0, 1.0, (1,)),
        observation_space=gymnasium.spaces.Box(-9.0, 9.0, (2,)),
    )
    try:
        envs.reset()
        observations = envs.step(np.array([[0.5], [-0.5]], np.float32))[0]
        assert observations.tolist() == [[0.5, 1.0], [-0.5, 1.0]]
    finally:
        envs.close()


def test_game_started_by_hand_is_waited_for(opener: Opener) -> None:
    with free_port("127.0.0.1") as port:
        arguments = (f"--serverPort={port}", "--serverIP=127.0.0.1", "--renderPath=x")
        command = [sys.executable, "-m", "tests.legacy.gymgodot.fake_game", "patient", *arguments]
        game = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL)
        env = opener.open("", exeCmd=None, serverPort=port)
    with game:
        env.reset()
        assert env.step(HALF)[0].tolist() == [0.5, 1.0]
        env.close()
        assert game.wait(30.0) == 0


def test_log_path_gets_the_output(opener: Opener, tmp_path: Path) -> None:
    env = opener.fake("walk", log_path=tmp_path / "game.log")
    env.close()
    assert (tmp_path / "game.log").read_text() == "playing walk\n"


@pytest.mark.parametrize(
    ("settings", "what"),
    [
        ({"observation_space": None}, "observation_space must be one of Discrete, Box"),
        ({"action_space": gymnasium.spaces.Dict({})}, "action_space must be one of"),
        ({"render_mode": "human"}, "render_mode is 'human'"),
        ({"proc_mode": "fork"}, "proc_mode is 'fork'"),
        ({"serverPort": "eight"}, "serverPort is 'eight'"),
        ({"serverPort": 65536}, "serverPort is 65536"),
        ({"serverIP": "0.0.0.0"}, "lets other machines connect"),
        ({"renderPath": "/a=b/"}, "holds a '='"),
        ({"renderPath": "frames/", "render_mode": "rgb_array"}, "must be absolute"),
    ],
)
@pytest.mark.filterwarnings("ignore:.*render_mode.*:UserWarning")
def test_unusable_arguments_are_refused(
    opener: Opener, settings: dict[str, Any], what: str
) -> None:
    with pytest.raises(ConfigError, match=what):
        opener.fake("walk", **settings)


@pytest.mark.parametrize(
    "action", [np.zeros(2), [np.nan], ["left"], [[0.5]], [[1], [2, 3]], None, {}], ids=str
)
def test_misfitting_action_leaves_the_game_running(opener: Opener, action: Any) -> None:
    env = opener.fake("walk").unwrapped
    env.reset()
    with pytest.raises(ActionError):
        env.step(action)
    assert env.step(HALF)[0].tolist() == [0.5, 1.0]


def test_reset_options_are_refused(opener: Opener) -> None:
    with pytest.raises(UsageError, match="unknown reset option 'level'"):
        opener.fake("walk").reset(options={"level": 2})
