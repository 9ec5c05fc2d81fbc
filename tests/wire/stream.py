"""Frames as tests compare them, cut from bytes or received over a socket."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from ludus.link import Link
from ludus.wire.frames import HEADER_BYTES, FrameType, decode_header


class Frame(NamedTuple):
    """One whole frame."""

    type: FrameType
    payload: bytes


def cut_frames(data: bytes) -> Iterator[Frame]:
    """Yield the whole frames in ``data``; what is left over at its end is ignored."""
    while len(data) >= HEADER_BYTES:
        frame_type, num_bytes = decode_header(data)
        end = HEADER_BYTES + num_bytes
        if len(data) < end:
            return
        yield Frame(frame_type, data[HEADER_BYTES:end])
        data = data[end:]


def receive_frames(pieces: Iterable[bytes], num_frames: int) -> list[Frame]:
    """Send ``pieces`` over a socket, close it, and return the frames that a link receives."""
    ours, theirs = socket.socketpair()

    def send() -> None:
        # Whoever has all frames that it wants may close before the last, empty piece.
        with theirs, contextlib.suppress(BrokenPipeError):
            for piece in pieces:
                theirs.sendall(piece)

    sender = threading.Thread(target=send)
    sender.start()
    link = Link(ours, timeout_s=20.0)
    try:
        return [Frame(*link.receive()) for _ in range(num_frames)]
    finally:
        link.close()
        sender.join()
