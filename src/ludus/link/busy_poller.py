"""Look for bytes again and again before going to sleep, as long as the core is free for that."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable

__all__ = ["Spinner"]

_AWAY_S = 0.001
"""Between one look and the next it takes so long only if the core was taken away meanwhile."""
_MAX_LOST = 5
"""Lost looks within `_LOST_WITHIN_S` that mean nothing: updates, or the system's own work."""
_LOST_WITHIN_S = 0.1
_FIRST_RESPITE_S = 0.1
"""How long nobody looks then; twice as long each time that the core is soon lost again."""
_LONGEST_RESPITE_S = 1.0


class Spinner:
    """Looks for bytes without sleeping, on a handle of its own.

    To wake up costs tens of microseconds, on both sides; to spin costs a core. Where another
    process wants that core, perhaps the very one that is waited for, spinning would cost
    milliseconds a message: each side looks in vain until the system takes the core away from it.
    So who often finds nothing, or loses the core meanwhile, leaves it alone for a while: a tenth
    of a second, or up to a second where that happens again and again.

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
        self._respite_s, self._respite_until = 0.0, 0.0
        self._lost_since, self._num_lost = 0.0, 0

    def read(self, view: memoryview) -> int | None:
        """Return the number of bytes read, 0 at the end of the stream, or None if nothing came.

        Raises:
            OSError: The connection is broken.
        """
        now = self._clock()
        if now < self._respite_until:
            return None
        end = now + self._spin_s
        count, was_away = None, False
        while now < end and count is None:
            before = now
            try:
                count = self._socket.recv_into(view)
            except BlockingIOError:
                count = None
            now = self._clock()
            if now - before > _AWAY_S:
                was_away = True
        if was_away or count is None:
            self._note_lost(now)
        return count

    def close(self) -> None:
        """Close the handle; may be called twice."""
        self._socket.close()

    def _note_lost(self, now: float) -> None:
        if now - self._lost_since > _LOST_WITHIN_S:
            self._lost_since, self._num_lost = now, 0
        self._num_lost += 1
        if self._num_lost > _MAX_LOST:
            is_soon = now - self._respite_until < _LONGEST_RESPITE_S
            longer = 2.0 * self._respite_s if is_soon else 0.0
            self._respite_s = min(max(longer, _FIRST_RESPITE_S), _LONGEST_RESPITE_S)
            self._respite_until = now + self._respite_s
