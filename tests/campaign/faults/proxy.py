"""A proxy between trainer and game: what it passes on comes late, cut, changed or never.

It lies in the trainer's own process, between the socket that was accepted and the link that reads
it, so that every engine, address and handshake has it.
"""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ludus.link import Link

__all__ = ["Lie", "Rewrite", "plant_proxy"]

Rewrite = Callable[[bytes], bytes]


@dataclass(frozen=True)
class Lie:
    """What happens to the bytes of a connection.

    Attributes:
        to_trainer: Direction.
        at: Byte of that direction at which it happens.
        kind: ``delay``, ``cut``, ``flip``, ``insert`` or ``drop``.
        value: Seconds, mask, bytes to insert, or number of bytes to drop.
    """

    to_trainer: bool
    at: int
    kind: str
    value: Any


def plant_proxy(lies: list[Lie], rewrite: Rewrite | None = None) -> None:
    """Put the proxy into every connection that this process opens from now on.

    Args:
        lies: The first connection has them all, the others none.
        rewrite: Changes pieces that come from the game, before the lies do.
    """
    make: Any = Link.__init__
    left = [lies]

    def make_lying(link: Link, connection: socket.socket, *rest: Any, **more: Any) -> None:
        ours, theirs = socket.socketpair()
        own = left.pop() if left else []
        for is_to_trainer in (True, False):
            ends = (connection, theirs) if is_to_trainer else (theirs, connection)
            mine = sorted((lie for lie in own if lie.to_trainer is is_to_trainer), key=_place)
            arguments = (*ends, mine, rewrite if is_to_trainer else None)
            threading.Thread(target=_pump, args=arguments, daemon=True).start()
        make(link, ours, *rest, **more)

    setattr(Link, "__init__", make_lying)  # noqa: B010 - pyright knows that it is no attribute


def _place(lie: Lie) -> int:
    return lie.at


def _pump(
    source: socket.socket, sink: socket.socket, lies: list[Lie], rewrite: Rewrite | None
) -> None:
    """Pass bytes on until one side closes; then close both."""
    source.settimeout(None)
    position = 0
    with contextlib.suppress(OSError):
        while piece := source.recv(1 << 16):
            data = bytearray(piece if rewrite is None else rewrite(piece))
            end = position + len(data)
            for lie in [lie for lie in reversed(lies) if lie.at < end]:
                lies.remove(lie)
                data = _tell(lie, data, lie.at - position, sink)
            sink.sendall(data)
            position = end
    for end_point in (source, sink):
        with contextlib.suppress(OSError):
            end_point.shutdown(socket.SHUT_RDWR)


def _tell(lie: Lie, data: bytearray, at: int, sink: socket.socket) -> bytearray:
    """Return what is passed on instead; raise ``OSError`` to cut the connection."""
    at = min(max(at, 0), len(data))
    match lie.kind:
        case "delay":
            time.sleep(lie.value)
        case "flip":
            data[at : at + 1] = bytes(byte ^ lie.value for byte in data[at : at + 1])
        case "insert":
            data[at:at] = lie.value
        case "drop":
            del data[at : at + lie.value]
        case _:
            sink.sendall(data[:at])
            raise OSError("cut")
    return data
