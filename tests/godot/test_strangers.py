"""Who may come in (docs/security.md), with a real game of every engine.

Games that listen, games that a trainer starts and games in which Play is pressed: strangers come
first, and are neither the trainer nor the engine.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
import psutil
import pytest

import ludus
from ludus.engine import (
    EngineProcess,
    GodotFlags,
    LaunchConfig,
    ensure_imported,
    executable_command,
    godot_command,
)
from ludus.errors import EngineStartError
from ludus.link import Link, LinkClosed
from ludus.session import LaunchOptions
from ludus.target import Executable, Scene
from ludus.target.kinds import DEFAULT_PORT
from ludus.wire.frames import FrameType, encode_frame
from ludus.wire.proof import make_nonce, make_proof
from tests.fake_engine import TOKEN
from tests.godot.conftest import Game, is_gone
from tests.godot.test_attach import await_port, free_port, running_game
from tests.link.test_peer import NOBODY, program
from tests.raw_trainer import TOKEN_ENV, greet
from tests.targets import find_game, find_scene
from tests.wire.reference import json_frame

ENGINES = ["cartpole", "godot3:cartpole", pytest.param("bevy:cartpole", marks=pytest.mark.bevy)]
pytestmark = [pytest.mark.engine, pytest.mark.timeout(300)]
DEADLINE_S = 30.0
REFUSAL = {"code": "version", "message": "\x1b[2J\nthe trainer is too old", "hint": "upgrade it"}


def command_of(target: str, *arguments: str) -> tuple[str, ...]:
    """Return the command line of CartPole as its developer would start it."""
    flags = GodotFlags(user_args=arguments)
    game = find_game(target)
    if isinstance(game, Executable):
        return executable_command(game.path, flags)
    assert isinstance(game, Scene)
    engine = game.find_engine()
    ensure_imported(engine, game.project)
    return godot_command(engine, game.project.root, game.path, flags)


@contextmanager
def listening(target: str, **env: str) -> Generator[tuple[EngineProcess, int]]:
    port = free_port()
    command = command_of(target, f"--ludus-listen=tcp:127.0.0.1:{port}")
    with EngineProcess.start(LaunchConfig(command=command, env=env)) as game:
        await_port(port)
        yield game, port


def connect(port: int, said: bytes = b"") -> socket.socket:
    connection = socket.create_connection(("127.0.0.1", port), DEADLINE_S)
    connection.sendall(said)
    return connection


def refuse(port: int, token: str) -> None:
    """Answer the game's greeting with an ERROR, with the proof for a token unless that is empty."""
    with connect(port) as connection:
        link = Link(connection, DEADLINE_S)
        report, nonce = REFUSAL, make_nonce()
        hello = json.loads(link.receive()[1])
        if token:
            proof = make_proof(token, "trainer", hello["nonce"], nonce)
            report = {**REFUSAL, "nonce": nonce, "proof": proof}
        link.send(json_frame("ERROR", report))
        with contextlib.suppress(LinkClosed):
            link.receive()


def reflect(port: int) -> dict[str, str]:
    """Send the game's own nonce back, with a proof that is none; return what it says to that."""
    with connect(port) as connection:
        link = Link(connection, DEADLINE_S)
        nonce = json.loads(link.receive()[1])["nonce"]
        link.send(json_frame("CHALLENGE", {"protocol": 2, "nonce": nonce, "proof": nonce}))
        frame_type, payload = link.receive()
        assert frame_type is FrameType.ERROR
        return json.loads(payload)


def train(target: str) -> None:
    envs = ludus.make_vec(target, num_worlds=3, num_engines=1)
    envs.reset(seed=1)
    assert np.all(envs.step(np.ones(3, np.int64))[1] == 1.0)
    envs.close()


@pytest.mark.parametrize("target", ENGINES)
def test_strangers_do_not_shut_the_trainer_out_of_a_game_that_listens(target: str) -> None:
    with ExitStack() as stack, listening(target) as (game, port):
        for said in [b""] * 8 + [b"\x05\0\0", b"GET / HTTP/1.1\r\n\r\n", b"\xff" * 5000]:
            stack.enter_context(connect(port, said))
        assert reflect(port)["code"] == "token"
        with pytest.raises(EngineStartError, match="token is not ours"):
            ludus.make_vec(f"127.0.0.1:{port}", launch=LaunchOptions(token=TOKEN))
        train(f"127.0.0.1:{port}")
        assert game.wait(DEADLINE_S) == 0, game.last_lines(20)


@pytest.mark.parametrize("target", ENGINES)
def test_a_game_that_listens_sends_its_token_to_nobody(target: str) -> None:
    with listening(target, **TOKEN_ENV) as (game, port), connect(port) as connection:
        link = Link(connection, DEADLINE_S)
        hello = greet(link)
        assert TOKEN not in repr(hello)
        link.send(encode_frame(FrameType.CLOSE))
        assert game.wait(DEADLINE_S) is not None


@pytest.mark.parametrize("target", ENGINES)
def test_a_game_whose_greeting_is_refused_quits(target: str) -> None:
    with listening(target, **TOKEN_ENV) as (game, port):
        refuse(port, TOKEN)
        assert game.wait(DEADLINE_S) == 1
        assert "the trainer is too old" in "\n".join(game.last_lines())
        assert "dropped" not in "\n".join(game.last_lines())
        with pytest.raises(OSError, match="refused"):
            connect(port)


@pytest.mark.parametrize("target", ENGINES)
def test_a_stranger_cannot_refuse_a_game_that_listens(target: str) -> None:
    """Neither by an ERROR, without a proof or with a wrong one, nor by CLOSE or by hanging up."""
    with listening(target) as (game, port):
        for token in ("", TOKEN):
            refuse(port, token)
        for said in (encode_frame(FrameType.CLOSE), b""):
            connect(port, said).close()
        train(f"127.0.0.1:{port}")
        assert game.wait(DEADLINE_S) == 0, game.last_lines(20)
        lines = [line for line in game.last_lines(50) if "ERROR without the trainer's" in line]
        assert len(lines) == 2, game.last_lines(50)
        assert all(line.isprintable() and "the trainer is too old" in line for line in lines)


@pytest.mark.parametrize("target", ENGINES)
def test_a_game_that_cannot_reach_its_trainer_does_not_outlive_it(target: str) -> None:
    """The trainer listens, and is killed before it has answered."""
    with (
        socket.create_server(("127.0.0.1", 0)) as silent,
        subprocess.Popen(["sleep", "600"]) as trainer,
    ):
        address = f"tcp:127.0.0.1:{silent.getsockname()[1]}"
        arguments = (f"--ludus-connect={address}", f"--ludus-parent={trainer.pid}")
        command = command_of(target, *arguments)
        with EngineProcess.start(LaunchConfig(command=command, env=TOKEN_ENV)) as game:
            silent.settimeout(DEADLINE_S)
            connection, _ = silent.accept()
            with connection:
                assert game.poll() is None
                trainer.kill()
                trainer.wait()
                assert game.wait(DEADLINE_S) is not None


def autoloaded(game: Game, folder: Path) -> Path:
    """Return a copy of a project in which the add-on is there from the start."""
    copy = Path(shutil.copytree(game.folder, folder / "game"))
    file = copy / "project.godot"
    if "[autoload]" not in file.read_text():
        (bridge,) = copy.rglob("ludus_bridge.gd")
        path = bridge.relative_to(copy).as_posix()
        file.write_text(f'{file.read_text()}\n[autoload]\n\nLudus="*res://{path}"\n')
    return copy


def test_a_game_that_hangs_before_it_connects_does_not_outlive_its_trainer(
    game: Game, tmp_path: Path
) -> None:
    """Its main scene loops for ever in `_ready`."""
    scene = find_scene(autoloaded(game, tmp_path), scene="res://hangs.tscn")
    engine = scene.find_engine()
    ensure_imported(engine, scene.project)
    with subprocess.Popen(["sleep", "600"]) as trainer:
        arguments = ("--ludus-connect=tcp:127.0.0.1:1", f"--ludus-parent={trainer.pid}")
        flags = GodotFlags(user_args=arguments)
        command = godot_command(engine, scene.project.root, scene.path, flags)
        with EngineProcess.start(LaunchConfig(command=command)) as process:
            assert process.wait(4.0) is None, process.last_lines()
            trainer.kill()
            trainer.wait()
            assert process.wait(DEADLINE_S) is not None


OPEN_AND_TELL = """
import sys
from ludus.session import open_session
from tests.targets import find_game, find_scene
from ludus.wire.handshake import EngineConfig
session = open_session(find_game(sys.argv[1]), EngineConfig())
print(session.pid, flush=True)
session.close()
"""


def ports_of(process: psutil.Process) -> list[int]:
    """Return the TCP ports at which a process listens."""
    found = process.net_connections("tcp")
    return [one.laddr[1] for one in found if one.status == psutil.CONN_LISTEN]


@pytest.mark.parametrize(
    ("target", "num_ports"),
    [
        ("cartpole", 0),
        ("godot3:cartpole", 1),
        pytest.param("bevy:cartpole", 0, marks=pytest.mark.bevy),
    ],
)
def test_no_port_is_open_where_both_sides_have_unix_sockets(target: str, num_ports: int) -> None:
    """And where there is a port, another user who connects first is not taken for the game."""
    with (
        subprocess.Popen(
            [sys.executable, "-c", OPEN_AND_TELL, target],
            stdout=subprocess.PIPE,
            text=True,
            cwd=Path(__file__).parents[2],
        ) as trainer,
        ExitStack() as stack,
    ):
        seen: list[int] = []
        watched = psutil.Process(trainer.pid)
        with contextlib.suppress(psutil.Error):
            while trainer.poll() is None:
                for port in set(ports_of(watched)) - {*seen}:
                    seen.append(port)
                    with contextlib.suppress(OSError):
                        stack.enter_context(connect(port, b"GET / HTTP/1.1\r\n\r\n"))
                    if os.geteuid() == 0:
                        stack.enter_context(program(FLOOD, str(port), user=NOBODY))
        assert trainer.wait(DEADLINE_S) == 0
        assert trainer.stdout is not None
        assert int(trainer.stdout.readline()) > 0
        assert len(seen) == num_ports


FLOOD = """
import socket, sys, time
for _ in range(20):
    try:
        connection = socket.create_connection(("127.0.0.1", int(sys.argv[1])))
        connection.sendall(b"hello")
    except OSError:
        break
print("done", flush=True)
"""


@pytest.mark.alone
def test_one_request_of_a_browser_does_not_end_the_wait_for_play() -> None:
    made: list[ludus.LudusEnv] = []
    waiter = threading.Thread(target=lambda: made.append(ludus.make("play")), daemon=True)
    waiter.start()
    await_port(DEFAULT_PORT)
    with ExitStack() as stack:
        for said in [b""] * 8 + [b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n", b"\x05\0\0"]:
            stack.enter_context(connect(DEFAULT_PORT, said))
        time.sleep(0.5)
        assert not made
        with running_game() as game:
            waiter.join(DEADLINE_S)
            assert made, game.last_lines(20)
            made[0].reset(seed=3)
            made[0].step(0)
            made[0].close()
            assert game.wait(DEADLINE_S) == 0


def test_half_a_header_is_bound_by_a_deadline(game: Game) -> None:
    """A trainer has an hour between two requests, and half a minute for the rest of one.

    Here that is two seconds.
    """
    [script] = game.folder.glob("addons/ludus/**/*link.gd")
    text, timeout = script.read_text(), "FRAME_TIMEOUT_MS := 30000"
    assert timeout in text
    script.write_text(text.replace(timeout, "FRAME_TIMEOUT_MS := 2000"))
    try:
        session = game.open()
    finally:
        script.write_text(text)
    assert session.pid is not None
    session._link.send(b"\x05\x00\x00")  # pyright: ignore[reportPrivateUsage]
    assert is_gone(session.pid, 15.0)
