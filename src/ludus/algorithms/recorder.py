"""The seam between acting and learning: what plays a policy and writes down what came of it.

A recorder needs the network and the settings, and nothing that learns, so it can be on another
machine than the learner. One machine or many: each engine draws from random streams of its own, so
equal seeds give equal actions however engines are spread over machines.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Protocol, runtime_checkable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ludus.algorithms.learner import Learner
from ludus.networks.policy import Policy
from ludus.spec.batch import ActionBatch, Batch

__all__ = ["Recorder", "Recording", "SharedLearner", "Weights", "pack_weights", "stream_seed",
           "unpack_weights"]  # fmt: skip

Recording = Mapping[str, NDArray[Any]]
"""What a recorder wrote down, by name; what the names mean is between recorder and learner."""

Weights = NDArray[np.uint8]
"""The parameters and buffers of a network as one vector of bytes."""


class Recorder(Protocol):
    """Plays one policy in the engines of one process.

    Per engine the order is :meth:`begin` once after a reset, then :meth:`act` and :meth:`record`
    in turn.

    Attributes:
        policy: What acts.
        number: Updates that its learner has made.
        is_exploring: Whether it acts at random.
    """

    policy: Policy
    number: int
    is_exploring: bool

    def begin(self, engine: int, batch: Batch) -> None:
        """Take the first observations of an engine that was reset."""
        ...

    def act(self, engine: int) -> ActionBatch:
        """Return the actions for the last observations; views that later calls overwrite."""
        ...

    def record(self, engine: int, batch: Batch) -> None:
        """Take the outcome of the last actions, and the observations to act on next."""
        ...

    def follow(self, number: int, is_exploring: bool) -> None:
        """Go on as the learner says, between two steps of all engines.

        Args:
            number: Updates that the learner has made; another one than before begins a rollout.
            is_exploring: Whether to act at random.
        """
        ...

    def take(self) -> Recording:
        """Return what was recorded since the last time; views that later calls overwrite."""
        ...


@runtime_checkable
class SharedLearner(Learner, Protocol):
    """A learner whose recorders can be on other machines.

    There, in the place of :meth:`begin`, :meth:`act` and :meth:`record`, the order is
    :meth:`forget` once after a reset, then :meth:`plan`, :meth:`learn_meanwhile` while recorders
    play, and :meth:`put`.
    """

    @property
    def recorder(self) -> Recorder:
        """Its own recorder, whose policy, number and exploring the others follow."""
        ...

    def plan(self) -> int:
        """Return the steps to play now; what recorders follow is up to date afterwards."""
        ...

    def learn_meanwhile(self) -> None:
        """Take the gradient steps that are due while recorders play."""
        ...

    def put(self, parts: Mapping[range, Recording]) -> None:
        """Take what the recorders on all machines have recorded, by engines."""
        ...

    def lose(self, engines: range, num_steps: int) -> None:
        """Note that what some of the engines did is lost."""
        ...

    def forget(self) -> None:
        """Note that every engine was reset elsewhere."""
        ...


def stream_seed(seed: int, number: int, engine: int) -> int:
    """Return the seed of what an engine, counted over all machines, draws after some updates."""
    words = np.random.SeedSequence((seed, number, engine)).generate_state(1, np.uint64)
    return int(words[0] >> np.uint64(1))


def pack_weights(policy: Policy) -> Weights:
    """Return a copy of the parameters and buffers of ``policy``."""
    parts = [tensor.detach().cpu().flatten().view(torch.uint8) for tensor in _tensors(policy)]
    return torch.cat(parts).numpy()


@torch.no_grad()
def unpack_weights(policy: Policy, weights: Weights) -> None:
    """Set the parameters and buffers of ``policy`` to what :func:`pack_weights` returned.

    Args:
        policy: Has the same networks.
        weights: May be read-only.
    """
    start = 0
    for tensor in _tensors(policy):
        stop = start + tensor.numel() * tensor.element_size()
        # A slice may begin anywhere; a copy is aligned, and may be written to.
        part = torch.from_numpy(weights[start:stop].copy())  # pyright: ignore[reportUnknownMemberType]
        tensor.copy_(part.view(tensor.dtype).view(tensor.shape))
        start = stop
    assert start == len(weights), "another network"


def _tensors(policy: Policy) -> Iterable[Tensor]:
    return [tensor for tensor in policy.state_dict().values() if tensor.numel()]
