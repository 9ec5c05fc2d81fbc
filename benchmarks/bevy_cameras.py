"""Pictures a second that agents of a Bevy game get: `python benchmarks/bevy_cameras.py`.

The game is `bevy:beacon`: two cameras of 48 × 36 in each world. Without a graphics card the engine
draws in software.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import tyro

from ludus.session import EngineSession, open_session
from ludus.spec.batch import ActionBatch
from ludus.target import Example
from ludus.wire.handshake import EngineConfig
from ludus.wire.reset import ResetRequest

TARGET = "bevy:beacon"
POLICY = "watcher"
NUM_ROUNDS = 4
SIZES = (("grid", 1), ("grid", 8), ("grid", 32), ("grid", 128), ("isolated", 4), ("isolated", 16))


@dataclass(frozen=True)
class Settings:
    """How to measure.

    Attributes:
        seconds: How long each of four rounds takes; the best one counts.
    """

    seconds: float = 1.0


def main(settings: Settings) -> None:
    """Measure both layouts, and print a table."""
    print("| worlds | cameras | pictures/s |\n|---|---|---|")
    for layout, num_worlds in SIZES:
        config = EngineConfig(num_worlds=num_worlds, layout=layout)
        session = open_session(Example(TARGET), config)
        session.reset(ResetRequest.all_worlds(num_worlds, 0))
        num_cameras = session.policies[POLICY].num_agents
        rounds = [steps_per_s(session, settings.seconds) for _ in range(NUM_ROUNDS)]
        session.close()
        speed = max(rounds) * num_cameras
        print(f"| {num_worlds}, {layout} | {num_cameras} | {speed:,.0f} |", flush=True)


def steps_per_s(session: EngineSession, seconds: float) -> float:
    """Take steps for so long."""
    num_agents = session.policies[POLICY].num_agents
    nothing = np.zeros((num_agents, 0), np.float32)
    actions = {POLICY: ActionBatch(np.zeros((num_agents, 1), np.int64), nothing)}
    began, num_steps = time.perf_counter(), 0
    while time.perf_counter() - began < seconds:
        session.send(actions)
        session.receive()
        num_steps += 1
    return num_steps / (time.perf_counter() - began)


if __name__ == "__main__":
    main(tyro.cli(Settings))
