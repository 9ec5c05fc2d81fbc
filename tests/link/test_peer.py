"""Whose program is at the other end (docs/security.md); another user plays the stranger."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Generator
from contextlib import contextmanager

import pytest

from ludus.errors import EngineStartError
from ludus.link import connect_until, is_loopback, is_strangers, listen_tcp, refuse_stranger

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells")
NOBODY = 65534
CONNECT = """
import socket, sys
connection = socket.socket(socket.AF_INET6 if sys.argv[2] == "6" else socket.AF_INET)
connection.connect(("::ffff:127.0.0.1" if sys.argv[2] == "6" else "127.0.0.1", int(sys.argv[1])))
print("connected", flush=True)
sys.stdin.read()
"""
LISTEN = """
import socket, sys
listener = socket.create_server(("127.0.0.1", 0))
print(listener.getsockname()[1], flush=True)
sys.stdin.read()
"""


@contextmanager
def program(script: str, *arguments: str, user: int | None) -> Generator[str]:
    """Run a program, as another user unless that is None; yields the first line it prints."""
    if user is not None and os.geteuid() != 0:
        pytest.skip("only root may run a program as another user")
    interpreter = "/usr/bin/python3" if user else sys.executable
    with subprocess.Popen(
        [interpreter, "-c", script, *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        user=user,
        cwd="/",
    ) as process:
        assert process.stdout is not None
        yield process.stdout.readline().strip()
        process.kill()


@pytest.mark.parametrize("family", ["4", "6"])
@pytest.mark.parametrize("user", [None, NOBODY])
def test_a_program_of_another_user_is_a_stranger(user: int | None, family: str) -> None:
    with listen_tcp(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
        with program(CONNECT, str(port), family, user=user) as said:
            assert said == "connected"
            connection, _ = listener.accept()
            with connection:
                assert is_strangers(connection) is (user is not None)


def test_one_who_has_gone_is_a_stranger() -> None:
    with listen_tcp(("127.0.0.1", 0)) as listener:
        socket.create_connection(listener.getsockname()).close()
        connection, _ = listener.accept()
        with connection:
            assert is_strangers(connection)


def test_a_unix_socket_is_ours() -> None:
    ours, theirs = socket.socketpair()
    with ours, theirs:
        assert not is_strangers(ours)


@pytest.mark.parametrize("user", [None, NOBODY])
def test_a_listener_of_another_user_is_refused(user: int | None) -> None:
    with program(LISTEN, user=user) as port:
        address = ("127.0.0.1", int(port))
        connect_until(address, 1.0, lambda: None).close()
        if user is None:
            refuse_stranger(address)
        else:
            with pytest.raises(EngineStartError, match="another user's program"):
                refuse_stranger(address)


@pytest.mark.parametrize(
    ("host", "is_local"),
    [
        ("127.0.0.1", True),
        ("127.9.9.9", True),
        ("::1", True),
        ("[::1]", True),
        ("localhost", True),
        ("127.0.0.1.evil.example", False),
        ("127.evil.example", False),
        ("localhost.evil.example", False),
        ("0.0.0.0", False),
        ("192.168.0.1", False),
        ("", False),
    ],
)
def test_only_this_machine_is_local(host: str, is_local: bool) -> None:
    assert is_loopback(host) is is_local
