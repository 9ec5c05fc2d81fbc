"""Sockets with deadlines."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import struct
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from ludus.errors import EngineTimeout, ProtocolError
from ludus.link import Link, LinkClosed, Listener, connect
from ludus.wire.frames import FrameType, encode_frame

TIMEOUT_S = 0.3
"""Of those tests in which it passes."""
PATIENCE_S = 20.0
PONG = encode_frame(FrameType.PONG, b"0123456789abcdef")
BATCH = encode_frame(FrameType.BATCH, bytes(range(100)))


class Ends:
    """Both ends of a connection."""

    def __init__(self) -> None:
        ours, self.theirs = socket.socketpair()
        self.link = Link(ours, PATIENCE_S)
        self.threads: list[threading.Thread] = []

    def beside(self, function: Callable[[], None]) -> None:
        self.threads.append(threading.Thread(target=function))
        self.threads[-1].start()

    def close(self) -> None:
        for thread in self.threads:
            thread.join(PATIENCE_S)
            assert not thread.is_alive()
        self.link.close()
        self.theirs.close()


@pytest.fixture
def ends() -> Iterator[Ends]:
    pair = Ends()
    yield pair
    pair.close()


@pytest.fixture
def hurried(ends: Ends) -> Ends:
    """Both ends, of which ours does not wait for long."""
    ends.link.timeout_s = TIMEOUT_S
    return ends


def drip(ends: Ends, data: bytes, pause_s: float = 0.0) -> None:
    for byte in data:
        ends.theirs.sendall(bytes([byte]))
        time.sleep(pause_s)


def test_a_frame_arrives(ends: Ends) -> None:
    ends.theirs.sendall(PONG)
    assert ends.link.receive() == (FrameType.PONG, b"0123456789abcdef")


def test_a_frame_arrives_byte_by_byte(ends: Ends) -> None:
    ends.beside(lambda: drip(ends, PONG, 0.001))
    assert ends.link.receive() == (FrameType.PONG, b"0123456789abcdef")


def test_a_batch_arrives_in_the_buffer_byte_by_byte(ends: Ends) -> None:
    ends.beside(lambda: drip(ends, BATCH))
    buffer = bytearray(len(BATCH))
    assert ends.link.receive_into(buffer, FrameType.BATCH) == 100
    assert buffer == BATCH


def test_frames_that_come_together_are_kept_apart(ends: Ends) -> None:
    ends.theirs.sendall(BATCH + PONG[:5])
    buffer = bytearray(500)
    assert ends.link.receive_into(buffer, FrameType.BATCH) == 100
    assert ends.link.has_pending
    ends.theirs.sendall(PONG[5:] + BATCH)
    assert ends.link.receive() == (FrameType.PONG, PONG[8:])
    assert ends.link.receive_into(buffer, FrameType.BATCH) == 100
    assert not ends.link.has_pending
    assert buffer[:108] == BATCH


def test_another_frame_than_the_expected_one_is_left(ends: Ends) -> None:
    ends.theirs.sendall(encode_frame(FrameType.ERROR, b"{}" + bytes(1000)) + PONG)
    assert ends.link.receive_into(bytearray(16), FrameType.BATCH) is None
    assert ends.link.receive() == (FrameType.ERROR, b"{}" + bytes(1000))
    assert ends.link.receive() == (FrameType.PONG, PONG[8:])


def test_a_frame_larger_than_the_buffer_is_refused(ends: Ends) -> None:
    ends.theirs.sendall(BATCH)
    with pytest.raises(ProtocolError, match="BATCH frame of 100 bytes, expected at most 92"):
        ends.link.receive_into(bytearray(100), FrameType.BATCH)


@pytest.mark.parametrize("into_buffer", [True, False])
def test_a_header_over_the_limit_is_refused(ends: Ends, into_buffer: bool) -> None:
    ends.theirs.sendall(struct.pack("<IBBH", 2**32 - 1, FrameType.BATCH, 0, 0))
    with pytest.raises(ProtocolError, match="limit"):
        if into_buffer:
            ends.link.receive_into(bytearray(100), FrameType.BATCH)
        else:
            ends.link.receive()


def test_silence_ends_at_the_deadline(hurried: Ends) -> None:
    with pytest.raises(EngineTimeout, match=r"silent for 0\.3 s"):
        hurried.link.receive()


def test_dripping_does_not_move_the_deadline(hurried: Ends) -> None:
    """If it did, the whole frame would come in, in the end."""
    is_over = threading.Event()

    def drip_on() -> None:
        for byte in BATCH:
            hurried.theirs.sendall(bytes([byte]))
            if is_over.wait(0.05):
                return

    hurried.beside(drip_on)
    try:
        with pytest.raises(EngineTimeout, match=r"within 0\.3 s|silent for 0\.3 s"):
            hurried.link.receive()
    finally:
        is_over.set()


@pytest.mark.parametrize("num_bytes", [0, 3, 8, 20])
def test_an_end_inside_a_frame_is_an_end(ends: Ends, num_bytes: int) -> None:
    ends.theirs.sendall(PONG[:num_bytes])
    ends.theirs.close()
    with pytest.raises(LinkClosed):
        ends.link.receive()


def test_nobody_reads(hurried: Ends) -> None:
    with pytest.raises(EngineTimeout, match=r"read nothing for 0\.3 s"):
        hurried.link.send(bytes(1 << 24))


def test_sending_to_nobody(ends: Ends) -> None:
    ends.theirs.close()
    with pytest.raises(LinkClosed):
        ends.link.send(PONG)
        ends.link.send(PONG)


def test_a_closed_link_is_closed(ends: Ends) -> None:
    ends.link.close()
    ends.link.close()
    with pytest.raises(LinkClosed):
        ends.link.receive()
    with pytest.raises(LinkClosed):
        ends.link.send(PONG)


def connect_to(address: str) -> socket.socket:
    kind, _, rest = address.partition(":")
    if kind == "unix":
        client = socket.socket(socket.AF_UNIX)
        client.connect(rest)
        return client
    host, _, port = rest.rpartition(":")
    return socket.create_connection((host, int(port)))


@pytest.mark.parametrize("kind", ["unix", "tcp"])
def test_an_engine_may_choose_the_address(kind: str) -> None:
    listener = Listener()
    assert [address.split(":")[0] for address in listener.addresses] == ["unix", "tcp"]
    address = next(a for a in listener.addresses if a.startswith(kind))
    with connect_to(address) as engine:
        link = listener.accept(5.0, lambda: None)
        engine.sendall(PONG)
        assert link.receive()[0] is FrameType.PONG
        link.close()
    listener.close()


def test_the_folder_of_the_socket_goes_with_the_listener() -> None:
    listener = Listener()
    path = Path(listener.addresses[0].removeprefix("unix:"))
    assert path.exists()
    assert path.parent.stat().st_mode & 0o077 == 0
    listener.close()
    listener.close()
    assert not path.parent.exists()


def test_nobody_connects() -> None:
    listener = Listener()
    with pytest.raises(EngineTimeout, match=r"no engine connected within 0\.2 s"):
        listener.accept(0.2, lambda: None)
    listener.close()


def test_waiting_ends_when_it_is_pointless() -> None:
    class EngineDiedError(Exception):
        pass

    def check() -> None:
        raise EngineDiedError

    listener = Listener()
    with pytest.raises(EngineDiedError):
        listener.accept(60.0, check)
    listener.close()


def test_a_taken_port_is_refused() -> None:
    first = Listener()
    port = int(first.addresses[-1].rpartition(":")[2])
    with pytest.raises(OSError, match="in use"):
        Listener(("127.0.0.1", port))
    first.close()


def test_connecting_to_an_engine_that_listens() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        link = connect(("127.0.0.1", server.getsockname()[1]), 5.0)
        engine, _ = server.accept()
        with engine:
            engine.sendall(PONG)
            assert link.receive() == (FrameType.PONG, PONG[8:])
        link.close()


def test_connecting_to_nobody() -> None:
    with socket.socket() as bound:  # so that nobody else can listen there meanwhile
        bound.bind(("127.0.0.1", 0))
        with pytest.raises(OSError, match="refused"):
            connect(bound.getsockname(), PATIENCE_S)


def test_the_sockets_of_a_killed_trainer_go_when_the_next_one_listens(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    pid = os.fork()
    if pid == 0:
        Listener()
        os.kill(os.getpid(), signal.SIGKILL)
    os.waitpid(pid, 0)
    (abandoned,) = tmp_path.iterdir()
    with contextlib.closing(Listener()), contextlib.closing(Listener()):
        assert not abandoned.exists()
        assert len(list(tmp_path.iterdir())) == 2
    assert not list(tmp_path.iterdir())
