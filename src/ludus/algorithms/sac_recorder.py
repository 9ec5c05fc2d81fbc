"""What acts for SAC, and makes transitions of what came of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ludus.algorithms.learner import LearnerSettings
from ludus.algorithms.recorder import Recording, stream_seed
from ludus.algorithms.replay import transitions
from ludus.algorithms.rollout import SlotState
from ludus.networks.dense import Network, accelerate
from ludus.networks.policy import Policy
from ludus.networks.tensors import as_tensor, as_tensors
from ludus.spec.batch import ActionBatch, Batch

__all__ = ["SACRecorder", "Store", "in_order"]

Store = Callable[[Mapping[str, NDArray[Any]]], None]
"""Gets the transitions of one step of one engine: views that are overwritten afterwards."""


class SACRecorder:
    """Acts and records for SAC; a :class:`~ludus.algorithms.recorder.Recorder`.

    Args:
        policy: What acts.
        settings: Slots of each engine, and the seed.
        store: Gets the transitions; None keeps copies for :meth:`take`.

    Attributes:
        policy: What acts.
        actor: The actor of ``policy``, or the same computed faster.
        is_exploring: Whether actions are drawn uniformly.
        number: Updates so far.
        acted: Actions of each engine since the last update.
        steps: Of these, how many have had an outcome.
    """

    def __init__(
        self, policy: Policy, settings: LearnerSettings, store: Store | None = None
    ) -> None:
        self.policy = policy
        is_plain = not (settings.is_mixed or settings.is_compiled)
        self.actor: Network = accelerate(policy.actor) if is_plain else policy.actor
        self.is_exploring = True
        self.number = 0
        self.acted = [0] * len(settings.engine_rows)
        self.steps = [0] * len(settings.engine_rows)
        self._settings = settings
        self._store = store or self._keep
        self._kept: list[dict[str, NDArray[Any]]] = []
        self._device = policy.device
        self._last = [
            SlotState.allocate(policy.input_spec, rows.stop - rows.start)
            for rows in settings.engine_rows
        ]
        self._frames = [policy.make_frame_stack(len(last.is_active)) for last in self._last]
        self._generators = [torch.Generator(self._device) for _ in self._last]

    def begin(self, engine: int, batch: Batch) -> None:
        """Take the first observations of an engine that was reset."""
        self._restart(engine)
        self._frames[engine].forget()
        self._last[engine].write_state(self._frames[engine].push_batch(batch))

    def restart(self) -> None:
        """Note that an update was made; one without any steps before it does not count."""
        self.number += any(self.steps)
        for engine in range(len(self._last)):
            self._restart(engine)

    def _restart(self, engine: int) -> None:
        self.acted[engine] = self.steps[engine] = 0
        number = self._settings.first_engine + engine
        seed = stream_seed(self._settings.seed, self.number, number)
        self._generators[engine].manual_seed(seed)

    @torch.inference_mode()
    def act(self, engine: int) -> ActionBatch:
        """Return actions for the last observations; views that the engine's next ones overwrite."""
        last, device, policy = self._last[engine], self._device, self.policy
        num, head = len(last.is_active), policy.head
        mask = as_tensor(last.mask, device) if head.num_logits and last.mask.size else None
        noise = torch.empty(num, head.num_noise, device=device)
        head.fill_noise(noise, self._generators[engine])
        if self.is_exploring:
            discrete, continuous = self._explore(noise, mask)
        else:
            is_on_cpu = device.type == "cpu"
            observation = last.tensors if is_on_cpu else as_tensors(last.observation, device)
            outputs = self.actor(policy.features(policy.encoder(observation)))
            discrete, continuous = head.sample(outputs, noise, mask)
        self.acted[engine] += 1
        last.discrete[...] = discrete.cpu().numpy()
        if not head.size:
            return ActionBatch(last.discrete, last.continuous)
        last.continuous[...] = continuous.tanh().cpu().numpy()
        return ActionBatch(last.discrete, head.to_bounds(continuous).cpu().numpy())

    def _explore(self, noise: Tensor, mask: Tensor | None) -> tuple[Tensor, Tensor]:
        """Return actions that are uniform over all that are allowed, before tanh."""
        head = self.policy.head
        outputs = torch.zeros(len(noise), head.num_outputs, device=self._device)
        discrete, _ = head.sample(outputs, noise, mask)
        normal = noise[:, head.num_logits :]
        return discrete, torch.atanh(torch.erf(normal * math.sqrt(0.5)))

    def record(self, engine: int, batch: Batch) -> None:
        """Take the outcome of the last actions, and the observations to act on next."""
        last, batch = self._last[engine], self._frames[engine].push_batch(batch)
        self._store(transitions(last, batch))
        last.write_state(batch)
        self.steps[engine] += 1

    # --- across machines ------------------------------------------------------------------------

    def _keep(self, fields: Mapping[str, NDArray[Any]]) -> None:
        self._kept.append({name: values.copy() for name, values in fields.items()})

    def follow(self, number: int, is_exploring: bool) -> None:
        """Explore or not, and note an update if there was one."""
        self.is_exploring = is_exploring
        if number != self.number:
            self.restart()
            self.number = number

    def take(self) -> Recording:
        """Return the transitions since the last time, and how many each engine had in each step."""
        kept, self._kept = self._kept, []
        part = {name: np.concatenate([of[name] for of in kept]) for name in kept[0]}
        counts = [len(fields["reward"]) for fields in kept]
        part["counts"] = np.reshape(counts, (-1, len(self.steps)))
        return part

    def forget(self) -> None:
        """Drop what was recorded: every engine was reset elsewhere."""
        self._kept.clear()
        for engine in range(len(self._last)):
            self._restart(engine)


def in_order(parts: Mapping[range, Recording]) -> Iterator[tuple[int, dict[str, NDArray[Any]]]]:
    """Yield engine and transitions of every step in the order in which one machine records them.

    Args:
        parts: What :meth:`SACRecorder.take` returned, by engines; as many steps of each.
    """
    ends = {engines: np.cumsum(part["counts"]).reshape(part["counts"].shape)
            for engines, part in parts.items()}  # fmt: skip
    num_steps = min((len(part["counts"]) for part in parts.values()), default=0)
    for step in range(num_steps):
        for engines, part in parts.items():
            for own, engine in enumerate(engines):
                stop = int(ends[engines][step, own])
                start = stop - int(part["counts"][step, own])
                fields = {name: of[start:stop] for name, of in part.items() if name != "counts"}
                yield engine, fields
