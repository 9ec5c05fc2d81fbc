"""Ports that are kept for a game until it listens."""

from __future__ import annotations

import errno
import socket
import sys

import pytest

from ludus.errors import EngineStartError
from ludus.legacy.godot_gym_api.connecting import check_port_is_free, free_port

HOST = "127.0.0.1"

only_linux = pytest.mark.skipif(sys.platform != "linux", reason="others cannot keep a port")


def test_nobody_listens_at_a_free_port() -> None:
    """Not even a process that another thread starts, and that inherits the socket."""
    with free_port(HOST) as port:
        check_port_is_free((HOST, port))


def server(port: int) -> socket.socket:
    """Listen with SO_REUSEADDR, as Godot does."""
    return socket.create_server((HOST, port))


def connect(port: int) -> socket.socket:
    return socket.create_connection((HOST, port))


@only_linux
def test_a_free_port_is_kept_from_others() -> None:
    with free_port(HOST) as port, socket.socket() as other:
        with pytest.raises(OSError) as error:
            other.bind((HOST, port))
        assert error.value.errno == errno.EADDRINUSE
    with socket.socket() as other:
        other.bind((HOST, port))


@only_linux
def test_a_game_listens_at_a_kept_port() -> None:
    with free_port(HOST) as port, server(port) as game, connect(port) as client:
        accepted, address = game.accept()
        accepted.close()
        assert address == client.getsockname()
        with pytest.raises(EngineStartError, match="something listens at"):
            check_port_is_free((HOST, port))
