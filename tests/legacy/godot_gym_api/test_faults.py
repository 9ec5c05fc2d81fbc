"""What a game can do wrong: hang up, freeze, talk nonsense, never come."""

from __future__ import annotations

import shlex
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import psutil
import pytest

from ludus.errors import (
    EngineCrashed,
    EngineError,
    EngineStartError,
    EngineTimeout,
    ProtocolError,
    SequenceError,
    TargetError,
)
from ludus.legacy.godot_gym_api import GodotClient
from ludus.legacy.godot_gym_api.connecting import free_port
from tests.legacy.godot_gym_api.compiled import WALK
from tests.legacy.godot_gym_api.conftest import ALL, Opener, left_processes
from tests.legacy.godot_gym_api.fake_game import Serve, Walk, answering, playing, read_request
from tests.legacy.gymgodot.conftest import await_so, command_of

pytestmark = pytest.mark.slow
HUGE = (1 << 26) + 1


def bytes_after_a_request(data: bytes, pause_s: float = 0.0) -> Serve:
    """Send raw bytes after the first request, a byte at a time if there is a pause."""

    def serve(connection: socket.socket) -> None:
        read_request(connection)
        pieces = [data] if pause_s == 0.0 else [data[i : i + 1] for i in range(len(data))]
        for piece in pieces:
            connection.sendall(piece)
            time.sleep(pause_s)
        read_request(connection)

    return serve


def hang_up_at_once(_connection: socket.socket) -> None:
    pass


def hang_up(connection: socket.socket) -> None:
    read_request(connection)


def frame(payload: bytes) -> bytes:
    return len(payload).to_bytes(4, "little") + payload


@pytest.mark.parametrize("serve", [hang_up, hang_up_at_once])
def test_hung_up_game_is_a_crash(opener: Opener, serve: Serve) -> None:
    with playing(serve) as address:
        client = opener.client(engine_address=address)
        with pytest.raises(EngineCrashed, match=r"closed the connection|reset|Broken pipe"):
            for _ in range(5):
                client.reset(ALL)
        with pytest.raises(SequenceError, match="the game is closed"):
            client.reset(ALL)


@pytest.mark.parametrize(
    ("answer", "what"),
    [
        (b"\xff\xfe", r"the answer is not JSON: b'\xff\xfe'"),
        (b"{]", "something that is not JSON"),
        (b'{"agent_data": 3}', "agent_data must be a JSON object"),
        (b'{"world_data": [1]}', "world_data must be a JSON object"),
        (b'{"agent_data": {"a": {"$bytes": 3}}}', "$bytes is not a text"),
        (b'{"agent_data": {"a": {"$bytes": "?"}}}', "$bytes is not base 64"),
        (b'{"agent_data": ' + b"[" * 100_000, "not JSON"),
        (b'{"agent_data": {"a": ' + b'{"b":' * 990 + b"1" + b"}" * 992, "not JSON"),
        (WALK.Message(agent_data={"place": 1.0}).SerializeToString(), "give the compiled module"),
    ],
)
def test_invalid_json_answers_are_refused(opener: Opener, answer: bytes, what: str) -> None:
    with playing(bytes_after_a_request(frame(answer))) as address:
        client = opener.client(engine_address=address)
        with pytest.raises(ProtocolError) as caught:
            client.reset(ALL)
        text = str(caught.value)
        assert what in text, text
        assert len(text) < 600
        with pytest.raises(SequenceError):
            client.reset(ALL)


@pytest.mark.parametrize("answer", [b"\x0a\x05\x01", b"\xff" * 11, b"\x0b"])
def test_invalid_protobuf_answers_are_refused(opener: Opener, answer: bytes) -> None:
    with playing(bytes_after_a_request(frame(answer))) as address:
        client = opener.client(WALK, address)
        with pytest.raises(ProtocolError, match="not such a protobuf message") as caught:
            client.reset(ALL)
        assert "same message.proto" in caught.value.hint


def test_announced_length_is_limited(opener: Opener) -> None:
    with playing(bytes_after_a_request(HUGE.to_bytes(4, "little"))) as address:
        client = opener.client(engine_address=address)
        with pytest.raises(ProtocolError, match=f"{HUGE} bytes is announced") as caught:
            client.reset(ALL)
        assert "max_answer_bytes" in caught.value.hint


def test_answer_limit_is_exact(opener: Opener) -> None:
    answer = b'{"agent_data": {"a": "' + b"x" * 970 + b'"}}'
    for limit, is_taken in ((len(answer), True), (len(answer) - 1, False)):
        with playing(answering(lambda _: answer)) as address:
            client = opener.client(engine_address=address, max_answer_bytes=limit)
            if is_taken:
                assert client.reset(ALL)["agent"].a == "x" * 970
            else:
                with pytest.raises(ProtocolError):
                    client.reset(ALL)
            client.close()


def test_messages_are_read_byte_by_byte(opener: Opener) -> None:
    data = frame(b'{"agent_data": {"a": 7}}')
    with playing(bytes_after_a_request(data, 0.005)) as address:
        client = opener.client(engine_address=address)
        assert client.reset(ALL)["agent"].a == 7
        client.close()


@pytest.mark.parametrize("data", [b"", b"\x09", frame(b"{}")[:-1]], ids=["none", "half", "most"])
def test_silent_game_times_out(opener: Opener, data: bytes) -> None:
    with playing(bytes_after_a_request(data)) as address:
        client = opener.client(engine_address=address, step_timeout_s=0.6)
        began = time.monotonic()
        with pytest.raises(EngineTimeout, match=r"did not answer .*reset.* within 0.6 s") as caught:
            client.reset(ALL)
        assert time.monotonic() - began < 15.0
        assert "one client at a time" in caught.value.hint


def test_unsolicited_answer_is_refused(opener: Opener) -> None:
    with playing(bytes_after_a_request(frame(b"{}") * 2)) as address:
        client = opener.client(engine_address=address)
        client.reset(ALL)
        time.sleep(0.3)
        with pytest.raises(ProtocolError, match="nobody had asked for"):
            client.reset(ALL)


def test_late_game_is_waited_for(opener: Opener) -> None:
    with free_port("127.0.0.1") as port:
        late = (
            "import socket, time; time.sleep(1.0); "
            f"s = socket.create_server(('127.0.0.1', {port})); "
            "c = s.accept()[0]; c.recv(99); c.sendall(b'\\x02\\0\\0\\0{}'); c.recv(9)"
        )
        command = f"{shlex.quote(sys.executable)} -c {shlex.quote(late)}"
        client = opener.client(engine_address=("127.0.0.1", port), command=command)
    assert client.reset(ALL)["agent"] == {}


def test_start_timeout_says_who_connected(opener: Opener) -> None:
    with free_port("127.0.0.1") as port:
        address = ("127.0.0.1", port)
        began = time.monotonic()
        with pytest.raises(
            EngineStartError, match=r"no game listened at .* within 0.5 s"
        ) as caught:
            opener.client(engine_address=address, start_timeout_s=0.5)
        assert time.monotonic() - began < 15.0
        assert "communication.start_server" in caught.value.hint
        with pytest.raises(EngineStartError, match="the process is still running"):
            opener.client(engine_address=address, start_timeout_s=0.5, command="sleep 60; true")
    assert left_processes() == []


@pytest.mark.parametrize(
    ("command", "code"), [("echo ERROR: no such scene; exit 3;", 3), ("there-is-no-such", 127)]
)
def test_command_that_ends_is_a_crash(opener: Opener, command: str, code: int) -> None:
    with pytest.raises(EngineCrashed, match=f"exit code {code}") as caught:
        opener.client(engine_address=("127.0.0.1", 0), command=command)
    assert code != 3 or "! ERROR: no such scene" in str(caught.value)
    assert left_processes() == []


def test_taken_address_is_a_start_error(opener: Opener) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        address = other.getsockname()
        with pytest.raises(EngineStartError, match=r"something listens at .* already") as caught:
            opener.client(engine_address=address, command="sleep 60")
    assert "port 0" in caught.value.hint
    assert left_processes() == []


@pytest.mark.parametrize("target", ["nowhere", "127.0.0.1:9090"])
def test_target_must_be_a_game(opener: Opener, tmp_path: Path, target: str) -> None:
    with pytest.raises(TargetError):
        opener.client(engine_address=("127.0.0.1", 0), target=target)
    with pytest.raises(TargetError):
        opener.client(engine_address=("127.0.0.1", 0), target=tmp_path)


def interrupt_after_a_request(connection: socket.socket) -> None:
    read_request(connection)
    time.sleep(0.3)  # the client waits for its answer now
    waiting = threading.main_thread().ident
    assert waiting is not None
    signal.pthread_kill(waiting, signal.SIGALRM)
    read_request(connection)


def test_an_interrupt_ends_the_conversation(opener: Opener) -> None:
    with playing(interrupt_after_a_request) as address:
        client = opener.client(engine_address=address)
        before = signal.signal(signal.SIGALRM, signal.default_int_handler)
        try:
            with pytest.raises(KeyboardInterrupt):
                client.reset(ALL)
        finally:
            signal.signal(signal.SIGALRM, before)
        with pytest.raises(SequenceError):
            client.reset(ALL)


START_AND_WAIT = """
from ludus.legacy.godot_gym_api import GodotClient
GodotClient(None, ("127.0.0.1", 0), command="sleep 300 #")
"""


def test_silent_game_ends_with_a_killed_trainer() -> None:
    """Not even a pipe that breaks ends a game that prints nothing."""
    with subprocess.Popen([sys.executable, "-c", START_AND_WAIT]) as trainer:
        games: list[psutil.Process] = []

        def is_playing() -> bool:
            games[:] = psutil.Process(trainer.pid).children(recursive=True)
            return any(command_of(game)[:2] == ["sleep", "300"] for game in games)

        await_so(is_playing)
        assert is_playing()
        trainer.kill()
        trainer.wait(10.0)
    assert psutil.wait_procs(games, timeout=30.0)[1] == []


def test_with_block_closes_the_client(opener: Opener) -> None:
    with playing(answering(Walk())) as address:
        with GodotClient(engine_address=address) as client:
            assert client.engine_address == address
            client.reset(ALL)
        with pytest.raises(SequenceError):
            client.reset(ALL)
    assert issubclass(EngineCrashed, EngineError)
    assert opener is not None
