"""Games of both Godots that somebody else started: one listens, in one Play was pressed."""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import psutil
import pytest

import ludus
from ludus.engine import (
    EngineKind,
    EngineProcess,
    GodotFlags,
    LaunchConfig,
    ensure_imported,
    find_engine,
    godot_command,
)
from ludus.errors import ConfigError, EngineStartError
from ludus.session import LaunchOptions
from ludus.target.kinds import DEFAULT_PORT, Play
from tests.targets import find_scene

pytestmark = pytest.mark.engine
START_TIMEOUT_S = 30.0
TOKEN = "a secret of enough characters"
both_engines = pytest.mark.parametrize("kind", list(EngineKind), ids=str)


@contextmanager
def running_game(*user_args: str, kind: EngineKind = EngineKind.GODOT4) -> Generator[EngineProcess]:
    """CartPole as its developer would start it, knowing nothing of a trainer."""
    project = find_scene(f"{kind}:cartpole").project
    engine = find_engine(kind)
    ensure_imported(engine, project)
    flags = GodotFlags(user_args=user_args)
    scene = "res://examples/cartpole/cartpole.tscn"
    command = godot_command(engine, project.root, scene, flags)
    with EngineProcess.start(LaunchConfig(command=command)) as process:
        yield process


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def await_port(port: int) -> None:
    """Wait until somebody listens, without connecting: the game serves one trainer."""
    deadline = time.monotonic() + START_TIMEOUT_S
    while not is_listened_at(port):
        assert time.monotonic() < deadline, f"nobody listens at port {port}"
        time.sleep(0.05)


def is_listened_at(port: int) -> bool:
    """Whether some process listens at a port; to bind it as a test would keep others from it."""
    return any(
        connection.status == psutil.CONN_LISTEN and tuple(connection.laddr)[1:] == (port,)
        for connection in psutil.net_connections("tcp")
    )


@both_engines
def test_a_game_that_listens_is_stepped_and_quits_afterwards(kind: EngineKind) -> None:
    port = free_port()
    with running_game(f"--ludus-listen=tcp:127.0.0.1:{port}", kind=kind) as game:
        await_port(port)
        envs = ludus.make_vec(f"127.0.0.1:{port}", num_worlds=3)
        observation, _ = envs.reset(seed=1)
        assert observation.shape == (3, 4)
        rewards = [envs.step(np.ones(3, np.int64))[1] for _ in range(20)]
        assert np.all(np.array(rewards) == 1.0)
        envs.close()
        assert game.wait(20.0) == 0


@both_engines
def test_attached_and_started_games_play_the_same_episode(kind: EngineKind) -> None:
    port = free_port()
    with running_game(f"--ludus-listen=tcp:127.0.0.1:{port}", kind=kind):
        await_port(port)
        attached = ludus.make(f"127.0.0.1:{port}")
        first, _ = attached.reset(seed=7)
        after = attached.step(1)[0]
        attached.close()
    started = ludus.make(f"{kind}:cartpole")
    assert np.array_equal(started.reset(seed=7)[0], first)
    assert np.array_equal(started.step(1)[0], after)
    started.close()


# The address belongs to a network of the test's own, so that no other machine is asked.
OTHER_MACHINE = 'ip address add 192.0.2.7/32 dev lo && ip link set lo up && exec "$0" -c "$1"'
ATTACH = """
import sys
from pathlib import Path
from ludus.cli.main import main
from tests.godot.test_attach import await_port, running_game

ours, theirs, runs = {ours!r}, {theirs!r}, {runs!r}
with running_game("--ludus-listen=tcp:192.0.2.7:9999", f"--ludus-token-file={{theirs}}") as game:
    await_port(9999)
    code = main(["train", "192.0.2.7:9999", "--num-engines", "1", "--num-worlds", "4",
                 "--total-steps", "2000", "--evaluation-episodes", "0", "--runs", runs,
                 "--token-file", ours])
    if code == 0:  # otherwise it goes on listening
        print("exit code of the game:", game.wait(20.0))
sys.exit(code)
"""


@pytest.mark.parametrize("is_same", [True, False])
def test_a_token_file_lets_a_trainer_attach_from_another_machine(
    is_same: bool, tmp_path: Path
) -> None:
    (tmp_path / "ours").write_text(f"{TOKEN}\n")
    (tmp_path / "theirs").write_text(TOKEN if is_same else TOKEN[::-1])
    names = ("ours", "theirs", "runs")
    script = ATTACH.format(**{name: str(tmp_path / name) for name in names})
    done = subprocess.run(
        ["unshare", "--map-root-user", "--net", "sh", "-c", OTHER_MACHINE, sys.executable, script],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        timeout=120.0,
        check=False,
    )
    if done.stderr.startswith("unshare:"):
        pytest.skip(f"this user may not make a network: {done.stderr.strip()}")
    if is_same:
        assert done.returncode == 0, done.stderr
        assert "exit code of the game: 0" in done.stdout
    else:
        assert done.returncode == 4, done.stderr
        assert "token" in done.stderr


def test_a_token_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    config = ludus.PoolConfig(token_file=tmp_path / "none")
    with pytest.raises(ConfigError, match=r"token_file .*none cannot be read"):
        ludus.open_pool("127.0.0.1:9", config)


def test_nobody_listens() -> None:
    with pytest.raises(EngineStartError, match="no game answers") as error:
        ludus.make(f"127.0.0.1:{free_port()}")
    assert "--ludus-listen" in error.value.hint


@pytest.mark.alone
@both_engines
def test_waiting_for_play(kind: EngineKind) -> None:
    import threading

    made: list[ludus.LudusEnv] = []
    waiter = threading.Thread(target=lambda: made.append(ludus.make("play")), daemon=True)
    waiter.start()
    await_port(DEFAULT_PORT)
    with running_game(kind=kind) as game:
        waiter.join(START_TIMEOUT_S)
        assert made, game.last_lines(20)
        observation, _ = made[0].reset(seed=3)
        assert observation.shape == (4,)
        made[0].step(0)
        made[0].close()
        assert game.wait(20.0) == 0


def test_nobody_presses_play() -> None:
    # At a port that no game of another test looks at.
    config = ludus.PoolConfig(launch=LaunchOptions(play_timeout_s=0.3))
    with pytest.raises(ludus.LudusError, match="no engine connected"):
        ludus.open_pool(Play("127.0.0.1", free_port()), config)


@both_engines
def test_without_a_trainer_the_game_plays_on(kind: EngineKind) -> None:
    with running_game(kind=kind) as game:
        assert game.wait(3.0) is None, game.last_lines(20)
        assert not game.script_errors


def test_another_machine_needs_a_token() -> None:
    with pytest.raises(EngineStartError, match="needs a token"):
        ludus.make("192.0.2.1:9", launch=LaunchOptions(token=TOKEN[:5]))
