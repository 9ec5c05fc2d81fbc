"""Look for bytes again and again before going to sleep, as long as the core is free for that."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable

__all__ = ["Spinner"]

_LONG_S = 0.002
"""A look that lasts longer hardly pays; on a core that others want, it lasts for milliseconds."""
_MAX_LONG = 2
"""Long looks within `_LONG_LOOKS_S` that mean nothing: an update, or the system's own work."""
_LONG_LOOKS_S = 0.1
_RESPITE_S = 1.0
"""How long nobody looks then."""


class Spinner:
    """Looks for bytes without sleeping, on a handle of its own.

    To wake up costs tens of microseconds, on both sides; to spin costs a core. Where another
    process wants that core, perhaps the very one that is waited for, spinning would cost
    milliseconds a message: each side looks in vain until the system takes the core away from it.
    So who often looks for long leaves the core alone for a second.

    Args:
        connection: Open socket; it keeps its timeout.
        spin_s: How long to look, seconds.
        clock: Returns seconds.
    """

    def __init__(
        self,
        connection: socket.socket,
        spin_s: float,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        # A second handle: one with a timeout would ask the system whether it may read first.
        self._socket = connection.dup()
        self._socket.setblocking(False)
        self._spin_s = spin_s
        self._clock = clock
        self._respite_until = 0.0
        self._long_since, self._num_long = 0.0, 0

    def read(self, view: memoryview) -> int | None:
        """Return the number of bytes read, 0 at the end of the stream, or None if nothing came.

        Raises:
            OSError: The connection is broken.
        """
        start = now = self._clock()
        if now < self._respite_until:
            return None
        count = None
        while now < start + self._spin_s and count is None:
            try:
                count = self._socket.recv_into(view)
            except BlockingIOError:
                count = None
            now = self._clock()
        if now - start > _LONG_S:
            self._note_long(now)
        return count

    def close(self) -> None:
        """Close the handle; may be called twice."""
        self._socket.close()

    def _note_long(self, now: float) -> None:
        if now - self._long_since > _LONG_LOOKS_S:
            self._long_since, self._num_long = now, 0
        self._num_long += 1
        if self._num_long > _MAX_LONG:
            self._respite_until = now + _RESPITE_S
