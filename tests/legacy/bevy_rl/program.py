"""Real programs with bevy_rl's REST interface, and sessions with them."""

from __future__ import annotations

import subprocess
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ludus.legacy.registry import GameAddress, find_bridge, open_bridge_session
from ludus.legacy.session import LegacySession
from ludus.spec.batch import ActionBatch, Batch
from ludus.wire.reset import ResetRequest

__all__ = ["Program", "Start", "reset", "step"]

_DEADLINE_S = 60.0
_POLICY = "agent"


class Program:
    """An example of ``rest_examples``, running.

    Args:
        executable: Built by Cargo; it prints its address when it listens.
        arguments: Of its command line.
        defaults: Settings of its sessions, unless a test sets them.
    """

    def __init__(self, executable: Path, *arguments: str, defaults: Mapping[str, Any]) -> None:
        self._defaults = defaults
        self.sessions: list[LegacySession] = []
        self.process = subprocess.Popen([executable, *arguments], stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        watchdog = threading.Timer(_DEADLINE_S, self.process.kill)
        watchdog.start()
        self.url = self.process.stdout.readline().strip()
        watchdog.cancel()
        assert self.url.startswith("http://127.0.0.1:"), self.url

    def open(self, max_episode_steps: int | None = None, **settings: Any) -> LegacySession:
        """Open a session, which ends with the program."""
        bridge = find_bridge(self.url)
        assert bridge is not None
        place = GameAddress(address=bridge.place_of(self.url))
        settings = {**self._defaults, **settings}
        self.sessions.append(open_bridge_session(bridge, place, settings, max_episode_steps))
        return self.sessions[-1]

    def close(self) -> None:
        """End it; nothing is left behind."""
        for session in self.sessions:
            session.close()
        self.process.kill()
        self.process.wait(_DEADLINE_S)
        assert self.process.stdout is not None
        self.process.stdout.close()


Start = Callable[..., Program]


def reset(session: LegacySession) -> Batch:
    """Begin an episode."""
    return session.reset(ResetRequest.all_worlds(1, 7))[_POLICY]


def step(session: LegacySession, *choices: int) -> Batch:
    """Take a step with one choice per agent."""
    discrete = np.array(choices, np.int64).reshape(-1, 1)
    session.send({_POLICY: ActionBatch(discrete, np.zeros((len(choices), 0), np.float32))})
    return session.receive()[_POLICY]
