"""Poll a socket without sleeping while the core is free, and back off when it is not."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable

__all__ = ["BusyPoller"]

_PREEMPTED_S = 0.001
"""Two polls are further apart than this only if the system took the core away between them."""
_MAX_MISSES = 5
"""Misses within `_MISS_WINDOW_S` that are tolerated: training updates, or the system's own work."""
_MISS_WINDOW_S = 0.1
_FIRST_BACKOFF_S = 0.1
"""Length of the first pause; it doubles each time that polling misses again soon after one."""
_MAX_BACKOFF_S = 1.0


class BusyPoller:
    """Reads without sleeping, on a second handle of a connection.

    Waking up costs tens of microseconds on both sides; polling costs a core. Where another process
    needs that core, perhaps the very one that is to answer, polling would cost milliseconds a
    message: each side polls until the system takes its core away. So after six empty or
    interrupted polls within a tenth of a second, this side blocks for 0.1 s, doubling up to 1 s.

    Args:
        connection: Open socket; it keeps its timeout.
        spin_s: How long to poll before giving up, seconds.
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
        self._backoff_s, self._backoff_until = 0.0, 0.0
        self._misses_since, self._num_misses = 0.0, 0

    def read(self, view: memoryview) -> int | None:
        """Return the number of bytes read, 0 at the end of the stream, or None if nothing came.

        Raises:
            OSError: The connection is broken.
        """
        now = self._clock()
        if now < self._backoff_until:
            return None
        end = now + self._spin_s
        count, was_preempted = None, False
        while now < end and count is None:
            before = now
            try:
                count = self._socket.recv_into(view)
            except BlockingIOError:
                count = None
            now = self._clock()
            if now - before > _PREEMPTED_S:
                was_preempted = True
        if was_preempted or count is None:
            self._record_miss(now)
        return count

    def close(self) -> None:
        """Close the handle; may be called twice."""
        self._socket.close()

    def _record_miss(self, now: float) -> None:
        if now - self._misses_since > _MISS_WINDOW_S:
            self._misses_since, self._num_misses = now, 0
        self._num_misses += 1
        if self._num_misses > _MAX_MISSES:
            is_soon = now - self._backoff_until < _MAX_BACKOFF_S
            longer = 2.0 * self._backoff_s if is_soon else 0.0
            self._backoff_s = min(max(longer, _FIRST_BACKOFF_S), _MAX_BACKOFF_S)
            self._backoff_until = now + self._backoff_s
