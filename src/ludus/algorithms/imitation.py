"""Learning from demonstrations: cloning before training, then a term of PPO's loss that fades.

The term is the one of demonstration-augmented policy gradients (Rajeswaran et al. 2018,
arXiv:1709.10087, section IV), without their factor for the advantage: its weight falls by a factor
with each update, so that what the rewards say decides in the end.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ludus.algorithms.adam import Adam
from ludus.algorithms.recurrence import Sequences, cut_into_sequences, run_memory
from ludus.datasets import Demonstrations
from ludus.networks.policy import Policy
from ludus.networks.tensors import as_tensor, as_tensors
from ludus.settings.train_config import ImitationConfig

__all__ = ["Cloning", "Imitation", "OnCloning"]

BATCH_SIZE = 256
"""Steps of demonstrations in one gradient step."""
NEGLIGIBLE = 1e-3
"""Share of the first weight below which demonstrations are left out."""
ADAM_EPSILON = 1e-5
MAX_GRAD_NORM = 1.0


@dataclass(frozen=True)
class Cloning:
    """How far the cloning of demonstrations is.

    Attributes:
        policy: Which one learns.
        demonstrations: What it is shown.
        epoch: Passes over all steps so far.
        epochs: Passes in all.
        wall_s: Seconds so far.
        loss: Mean negative log-probability of the actions in the last gradient step, nats.
    """

    policy: str
    demonstrations: Demonstrations
    epoch: int
    epochs: int
    wall_s: float
    loss: float


OnCloning = Callable[[Cloning], None]
"""Is told after every pass."""


class Imitation:
    """The demonstrations of one policy, and how much they count.

    Args:
        policy: What learns; its device is where the demonstrations are kept.
        demonstrations: What it is shown.
        config: Settings.
        sequence_length: Steps over which gradients flow back through a memory.

    Attributes:
        num_updates: Updates in which the demonstrations have counted so far.
    """

    def __init__(
        self,
        policy: Policy,
        demonstrations: Demonstrations,
        config: ImitationConfig,
        sequence_length: int,
    ) -> None:
        self.num_updates = 0
        self._config = config
        self._demonstrations = demonstrations
        device = policy.device
        self._observation = as_tensors(_stacked(policy, demonstrations), device)
        self._discrete = as_tensor(demonstrations.actions.discrete, device)
        continuous = as_tensor(demonstrations.actions.continuous, device)
        self._continuous = policy.head.from_bounds(continuous)
        mask = demonstrations.mask
        self._mask = None if mask is None else as_tensor(mask, device)
        self._sequence_length = sequence_length
        self._sequences: Sequences | None = None
        self._losses: list[Tensor] = []

    @property
    def weight(self) -> float:
        """Weight of the demonstrations' loss in this update; exactly 0 once it is negligible."""
        share = self._config.decay**self.num_updates
        return self._config.weight * share if share > NEGLIGIBLE else 0.0

    def clone(self, policy: Policy, seed: int, on_cloning: OnCloning) -> None:
        """Make the demonstrated actions probable (behaviour cloning).

        Observation statistics become those of the demonstrations.
        """
        start, loss = time.perf_counter(), torch.zeros(())
        if policy.encoder.normaliser is not None:
            policy.encoder.normaliser.update(policy.encoder.join(self._observation))
        generator = torch.Generator(policy.device).manual_seed(seed)
        optimiser = Adam(policy.parameters(), ADAM_EPSILON)
        epochs = self._config.epochs
        for epoch in range(1, epochs + 1):
            self._remember(policy)
            for rows in self._batches(generator):
                loss = self._loss(policy, rows)
                optimiser.zero_gradients()
                cast(Any, loss).backward()
                optimiser.clip_grad_norm(MAX_GRAD_NORM)
                optimiser.step(self._config.learning_rate)
            wall_s, last = time.perf_counter() - start, float(loss.detach())
            shown = self._demonstrations
            on_cloning(Cloning(policy.spec.name, shown, epoch, epochs, wall_s, last))

    def begin_update(self, policy: Policy) -> None:
        """Prepare for gradient steps on :meth:`penalty`."""
        self._losses = []
        if self.weight:
            self._remember(policy)

    def penalty(self, policy: Policy, generator: torch.Generator) -> Tensor:
        """Return what to add to the loss of one gradient step, of some of the demonstrations."""
        if not self.weight:
            return torch.zeros((), device=policy.device)
        loss = self._loss(policy, next(self._batches(generator)))
        self._losses.append(loss.detach())
        return self.weight * loss

    def end_update(self) -> dict[str, float]:
        """Let the weight fall; return the metrics of the update."""
        metrics = {"imitation_weight": self.weight}
        if self._losses:
            metrics["imitation_loss"] = float(torch.stack(self._losses).mean())
        self.num_updates += 1
        return metrics

    def _batches(self, generator: torch.Generator) -> Iterator[Tensor]:
        """Yield the numbers of all steps, or of all sequences, in random order."""
        sequences = self._sequences
        count = len(self._discrete) if sequences is None else len(sequences)
        size = BATCH_SIZE if sequences is None else max(1, BATCH_SIZE // len(sequences.keep))
        order = torch.randperm(count, generator=generator, device=generator.device)
        for first in range(0, count, size):
            yield order[first : first + size]

    def _loss(self, policy: Policy, chosen: Tensor) -> Tensor:
        """Return the mean negative log-probability of some of the demonstrated actions.

        The deviation of continuous actions is held: demonstrations do not explore, and would take
        it to 0, after which nothing is tried that they do not show.
        """
        sequences = None if self._sequences is None else self._sequences.choose(chosen)
        rows = chosen if sequences is None else sequences.rows
        features = self._features(policy, rows)
        if sequences is not None:
            remembered = run_memory(policy, features, sequences.start, sequences.keep)[1]
            features, rows = remembered[sequences.is_valid], rows[sequences.is_valid]
        mask = None if self._mask is None else self._mask[rows]
        log_prob, _ = policy.head.evaluate(
            policy.actor(features), self._discrete[rows], self._continuous[rows], mask,
            is_deviation_held=True,
        )  # fmt: skip
        return -log_prob.mean()

    def _features(self, policy: Policy, rows: Tensor) -> Tensor:
        entries = {name: entry[rows] for name, entry in self._observation.items()}
        return policy.features(policy.encoder(entries))

    @torch.no_grad()
    def _remember(self, policy: Policy) -> None:
        """Cut the episodes into sequences that begin with what the memory holds there by now."""
        if not policy.memory_size:
            return
        table, is_valid = self._table(policy.device)
        rows = table.flatten()
        parts = [rows[first : first + BATCH_SIZE] for first in range(0, len(rows), BATCH_SIZE)]
        features = torch.cat([self._features(policy, part) for part in parts])
        keep = torch.ones_like(is_valid)
        start = torch.zeros(table.shape[1], policy.memory_size, device=policy.device)
        states = run_memory(policy, features, start, keep)[0]
        before = torch.cat([start.unsqueeze(0), states[:-1]])
        sequences = cut_into_sequences(before, keep, is_valid, self._sequence_length)
        is_used = sequences.is_valid.view(self._sequence_length, -1).any(0)
        self._sequences = replace(sequences, rows=rows[sequences.rows]).choose(is_used)

    def _table(self, device: torch.device) -> tuple[Tensor, Tensor]:
        """Return ``int64[steps, episodes]``, numbers of steps, and which of them there are."""
        lengths = torch.tensor(self._demonstrations.lengths, device=device)
        num_parts = -(-max(self._demonstrations.lengths) // self._sequence_length)
        steps = torch.arange(num_parts * self._sequence_length, device=device).unsqueeze(1)
        is_valid = steps < lengths
        return (steps + lengths.cumsum(0) - lengths) * is_valid, is_valid


def _stacked(policy: Policy, demonstrations: Demonstrations) -> dict[str, NDArray[Any]]:
    """Return all frames that the policy looks at in each step, ``dtype[n, *shape]`` per entry."""
    if policy.num_frames == 1:
        return demonstrations.observation
    lengths = np.asarray(demonstrations.lengths)
    first = np.repeat(lengths.cumsum() - lengths, lengths)
    back = np.arange(1 - policy.num_frames, 1)
    steps = np.maximum(np.arange(len(first))[:, None] + back, first[:, None])
    return {
        entry.name: demonstrations.observation[entry.name][steps].reshape(-1, *entry.shape)
        for entry in policy.input_spec.observation
    }
