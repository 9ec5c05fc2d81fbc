"""Takes the frames of a Godot game, in the order in which it draws them, each once.

``recorder.gd`` replaces Godot's main loop in the game, and sends every frame over a separate
connection. It waits until the frame is taken, so that none is lost; game time stops until then.
"""

from __future__ import annotations

import contextlib
import hmac
import secrets
import socket
import struct
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ludus.engine.kinds import EngineKind
from ludus.errors import EngineCrashed, EngineStartError, EngineTimeout, LudusError, ProtocolError
from ludus.record.film import Frame

__all__ = ["Camera"]

VARIABLE = "LUDUS_RECORD"
BEGIN, END = b"b", b"e"
MAX_SIDE = 16384
SILENCE_S = 120.0
"""How long the game may take for a frame."""

_HEADER = struct.Struct("<II")
_SCRIPTS = {EngineKind.GODOT4: "recorder.gd", EngineKind.GODOT3: "recorder3.gd"}
_POLL_S = 0.05


class Camera:
    """Hands the frames of one game to ``take``, in its own thread.

    Set :attr:`variable` and :meth:`engine_args` for the game, start it, then :meth:`connect`,
    :meth:`begin`, let it play, :meth:`end`, close the game, :meth:`finish`.

    Args:
        take: Gets every frame.
        every: Frames of the game for one frame of the film.
        num_frames: Frames to take at most; None: as many as come.

    Attributes:
        num_frames: Frames taken so far.
    """

    def __init__(self, take: Callable[[Frame], None], every: int, num_frames: int | None) -> None:
        self._take = take
        self._limit = num_frames
        self._token = secrets.token_hex(16)
        self._listener = socket.create_server(("127.0.0.1", 0))
        port = self._listener.getsockname()[1]
        self.variable: dict[str, str] = {VARIABLE: f"{port} {self._token} {every}"}
        self.num_frames = 0
        self._link: socket.socket | None = None
        self._thread = threading.Thread(target=self._run, name="ludus-camera", daemon=True)
        self._has_end = False
        self._error: BaseException | None = None

    @staticmethod
    def engine_args(kind: EngineKind) -> tuple[str, ...]:
        """Return what the command line of the game needs."""
        script = Path(__file__).with_name(_SCRIPTS[kind])
        return ("--script", str(script), "--audio-driver", "Dummy")

    @property
    def is_full(self) -> bool:
        """Whether no more frames are wanted."""
        return self._limit is not None and self.num_frames >= self._limit

    def connect(self, timeout_s: float, check: Callable[[], None]) -> None:
        """Wait for the game; ``check`` raises if that has become pointless.

        Raises:
            EngineStartError: It did not connect.
        """
        deadline = time.monotonic() + timeout_s
        self._listener.settimeout(_POLL_S)
        while self._link is None and time.monotonic() < deadline:
            check()
            try:
                self._greet(self._listener.accept()[0])
            except TimeoutError:
                continue
        if self._link is None:
            raise EngineStartError(
                f"the game sent no frames within {timeout_s:g} s",
                hint="check that `ludus play` opens its window",
            )
        self._link.settimeout(SILENCE_S)
        self._thread.start()

    def begin(self) -> None:
        """Take every frame from now on."""
        self._send(BEGIN)

    def end(self) -> None:
        """Take no more.

        Let the game go on until :meth:`finish` has returned: before its next frame it tells that
        it has sent everything.
        """
        self._send(END)

    def check(self) -> None:
        """Raise what went wrong with the film so far, if anything did."""
        if self._error is not None:
            raise self._error

    def finish(self) -> None:
        """Wait for the last frame.

        Raises:
            EngineCrashed: The game went away before it had sent all.
            LudusError: What ``take`` raised.
        """
        self._thread.join(SILENCE_S)
        self.check()
        if not self._has_end:
            raise EngineCrashed("the game ended before all of its frames had arrived")

    def close(self) -> None:
        """Let go of the game; may be called twice."""
        self._listener.close()
        if self._link is not None:
            self._hang_up()
            if self._thread.is_alive():
                self._thread.join(SILENCE_S)
            self._link.close()

    def _greet(self, link: socket.socket) -> None:
        """Keep the connection if it knows the token."""
        link.settimeout(1.0)
        try:
            token = _read(link, len(self._token))
        except (OSError, EOFError):
            token = b""
        if hmac.compare_digest(token, self._token.encode()):
            self._link = link
        else:
            link.close()

    def _hang_up(self) -> None:
        assert self._link is not None
        with contextlib.suppress(OSError):  # the game may have done so before
            self._link.shutdown(socket.SHUT_RDWR)

    def _send(self, word: bytes) -> None:
        assert self._link is not None
        with contextlib.suppress(OSError):  # the game has gone, which `finish` tells better
            self._link.sendall(word)

    def _run(self) -> None:
        assert self._link is not None
        try:
            while (frame := self._next(self._link)) is not None:
                if not self.is_full:
                    self._take(frame)
                    self.num_frames += 1
        except (LudusError, MemoryError) as error:
            self._error = error
            self._hang_up()  # or the game would wait until somebody takes its next frame
        except TimeoutError:
            self._error = EngineTimeout(f"the game drew no frame for {SILENCE_S:g} s")
        except (OSError, EOFError):
            return  # the game has gone

    def _next(self, link: socket.socket) -> Frame | None:
        """Return the next frame, or None after the last one."""
        header = _read(link, _HEADER.size)
        width, height = _HEADER.unpack(header)
        if width == 0:
            self._has_end = True
            return None
        if width > MAX_SIDE or height > MAX_SIDE:
            raise ProtocolError(f"the game sent a frame of {width}×{height} pixels")
        pixels = np.frombuffer(_read(link, width * height * 3), np.uint8)
        return pixels.reshape(height, width, 3)


def _read(link: socket.socket, num_bytes: int) -> bytearray:
    data = bytearray(num_bytes)
    view = memoryview(data)
    while view:
        count = link.recv_into(view)
        if count == 0:
            raise EOFError
        view = view[count:]
    return data
