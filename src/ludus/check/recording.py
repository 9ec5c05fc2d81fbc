"""Episodes of random play, recorded for comparison and examination."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ludus.play.players import random_player
from ludus.pool import EnginePool
from ludus.spec import Spec
from ludus.spec.batch import Batch, Batches

__all__ = ["Frame", "Recording", "named_arrays", "play", "record"]

MAX_RECORDING_BYTES = 256 * 1024 * 1024


@dataclass(frozen=True)
class Frame:
    """What an engine answered to one request.

    Attributes:
        tick: The engine's tick counter.
        batches: A batch per policy.
    """

    tick: int
    batches: dict[str, Batch]

    def digest(self) -> bytes:
        """Return a hash of all arrays; the tick does not count."""
        total = hashlib.blake2b(digest_size=32)
        for name, batch in self.batches.items():
            for what, array in named_arrays(batch):
                total.update(f"{name}/{what}:{array.dtype.str}{array.shape}".encode())
                total.update(np.ascontiguousarray(array).tobytes())
        return total.digest()


@dataclass(frozen=True)
class Recording:
    """The answers to a seeded reset and to the steps after it.

    Attributes:
        spec: What the engine declared.
        seed: Seed of world 0; world *i* had ``seed + i``.
        frames: The answer to the reset, then one per step.
    """

    spec: Spec
    seed: int
    frames: tuple[Frame, ...]

    @property
    def num_steps(self) -> int:
        """Number of steps after the reset."""
        return len(self.frames) - 1

    def world(self, index: int) -> Recording:
        """Return the recording of one world, as if it were the only one."""
        frames = tuple(
            Frame(
                frame.tick,
                {
                    policy.name: _rows_of(frame.batches[policy.name], policy.world_slots(index))
                    for policy in self.spec.policies
                },
            )
            for frame in self.frames
        )
        policies = tuple(
            replace(policy, agents=policy.agents[policy.world_slots(index)])
            for policy in self.spec.policies
        )
        spec = replace(self.spec, num_worlds=1, policies=policies)
        return Recording(spec, self.seed + index, frames)

    def first_ends(self) -> NDArray[np.int64]:
        """Return ``int64[num_worlds]``: the first step in which an agent's episode ended.

        It is ``num_steps + 1`` for worlds in which none did.
        """
        first = np.full(self.spec.num_worlds, self.num_steps + 1, np.int64)
        for step, frame in reversed(list(enumerate(self.frames))):
            for policy in self.spec.policies:
                worlds = frame.batches[policy.name].final_index // policy.agents_per_world
                first[worlds] = step
        return first

    def digest(self) -> str:
        """Return a hash of all frames, hexadecimal."""
        total = hashlib.blake2b(digest_size=16)
        for frame in self.frames:
            total.update(frame.digest())
        return total.hexdigest()


def record(
    pool: EnginePool, seed: int, num_steps: int, action_seed: int | None = None
) -> Recording:
    """Reset all worlds with a seed and play random actions.

    Fewer than ``num_steps`` steps are played if their frames would take too much memory.

    Args:
        pool: One engine.
        seed: World *i* gets ``seed + i``.
        num_steps: Steps to play at most.
        action_seed: Like ``seed``, for the actions; None: ``seed``.
    """
    batches = pool.reset(seed)
    arrays = [array for batch in batches.values() for _, array in named_arrays(batch)]
    num_steps = max(1, min(num_steps, MAX_RECORDING_BYTES // sum(array.nbytes for array in arrays)))
    frames = play(pool, batches, num_steps, seed if action_seed is None else action_seed)
    return Recording(pool.spec, seed, frames)


def play(pool: EnginePool, batches: Batches, num_steps: int, seed: int) -> tuple[Frame, ...]:
    """Take random actions; return a frame of ``batches``, and one for each step.

    Args:
        pool: One engine.
        batches: What it answered last.
        num_steps: Steps to play.
        seed: World *i* draws its actions from a stream seeded with ``seed + i``.
    """
    act = random_player(pool, seed)
    frames = [Frame(pool.times(0).tick, batches)]
    for _ in range(num_steps):
        batches = pool.step(act(batches))
        frames.append(Frame(pool.times(0).tick, batches))
    return tuple(frames)


def named_arrays(batch: Batch) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield every array of a batch in a fixed order, the most informative first."""
    for entry, values in batch.observation.items():
        yield f'observation["{entry}"]', values
    yield "reward", batch.reward
    yield "terminated", batch.terminated
    yield "truncated", batch.truncated
    yield "active", batch.active
    if batch.action_mask is not None:
        yield "action_mask", batch.action_mask
    yield "final_index", batch.final_index
    for entry, values in batch.final_observation.items():
        yield f'final_observation["{entry}"]', values


def _rows_of(batch: Batch, rows: slice) -> Batch:
    own = (batch.final_index >= rows.start) & (batch.final_index < rows.stop)
    return Batch(
        observation={name: values[rows] for name, values in batch.observation.items()},
        reward=batch.reward[rows],
        terminated=batch.terminated[rows],
        truncated=batch.truncated[rows],
        active=batch.active[rows],
        action_mask=None if batch.action_mask is None else batch.action_mask[rows],
        final_index=batch.final_index[own] - rows.start,
        final_observation={name: values[own] for name, values in batch.final_observation.items()},
    )
