"""Proximal policy optimisation (Schulman et al. 2017, arXiv:1707.06347), to be read from the top.

A rollout of ``rollout_steps`` steps of all agents is collected with one network. Nothing but
actions is computed meanwhile: log-probabilities and values of the whole rollout are computed in
one batch when it is complete, which keeps each step short. Observation statistics change after
the update, so that both see the same numbers.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ludus.batch import ActionBatch, Batch
from ludus.errors import DivergenceError
from ludus.train.adam import Adam
from ludus.train.advantage import generalised_advantage
from ludus.train.config import PPOConfig
from ludus.train.learner import LearnerState
from ludus.train.load_tensors import load_tensors
from ludus.train.networks import Inputs
from ludus.train.normalise import RewardScaler
from ludus.train.policy import Policy
from ludus.train.rollout import Rollout
from ludus.train.tensors import as_tensor, as_tensors, to_numbers

__all__ = ["PPO", "Transitions", "clipped_surrogate", "value_loss"]

ADAM_EPSILON = 1e-5
LOSS_METRICS: tuple[str, ...] = (
    "policy_loss",
    "value_loss",
    "entropy",
    "approximate_kl",
    "clip_fraction",
    "grad_norm",
)


@dataclass(frozen=True)
class Transitions:
    """``n`` transitions to learn from; all slots that were active.

    Attributes:
        inputs: What was observed.
        discrete: ``int64[n, d]``.
        continuous: ``float32[n, c]``, unclipped.
        mask: ``bool[n, mask_size]``, None without masks.
        log_prob: ``float32[n]``, of the action when it was taken.
        value: ``float32[n]``, V of the state when the action was taken.
        advantage: ``float32[n]``.
        target: ``float32[n]``, what the value should have been.
    """

    inputs: Inputs
    discrete: Tensor
    continuous: Tensor
    mask: Tensor | None
    log_prob: Tensor
    value: Tensor
    advantage: Tensor
    target: Tensor

    def rows(self, index: Tensor | slice) -> Transitions:
        """Return some of the transitions."""
        return Transitions(
            self.inputs.rows(index),
            self.discrete[index],
            self.continuous[index],
            None if self.mask is None else self.mask[index],
            self.log_prob[index],
            self.value[index],
            self.advantage[index],
            self.target[index],
        )

    def __len__(self) -> int:
        return len(self.log_prob)


class PPO:
    """Trains one policy by PPO; a :class:`~ludus.train.learner.Learner`."""

    def __init__(
        self, policy: Policy, config: PPOConfig, engine_rows: list[slice], seed: int
    ) -> None:
        self.policy = policy
        self.config = config
        self._device = policy.head.log_std.device
        self._optimiser = Adam(policy.parameters(), ADAM_EPSILON)
        self._learning_rate = config.learning_rate
        self._rollout = Rollout(policy.spec, config.rollout_steps, engine_rows)
        num_agents = self._rollout.num_agents
        self._scaler = RewardScaler(num_agents, config.discount).to(self._device)
        self._generator = torch.Generator(self._device).manual_seed(seed)
        shape = (config.rollout_steps, num_agents, policy.head.num_outputs)
        self._noise = torch.zeros(shape, device=self._device)
        self._engine_noise = [[step[rows] for step in self._noise] for rows in engine_rows]
        self._has_noise = False
        self._steps = [0] * len(engine_rows)

    # --- collecting -----------------------------------------------------------------------------

    @property
    def num_steps_left(self) -> int:
        """Steps of every engine until the next update."""
        return self.config.rollout_steps - min(self._steps)

    def begin(self, engine: int, batch: Batch) -> None:
        """Take the first observations of an engine that was reset; drops unfinished rollouts."""
        self._steps[engine] = 0
        self._rollout.forget()
        self._scaler.forget()
        self._rollout.views[engine][0].write_state(batch)

    @torch.inference_mode()
    def act(self, engine: int) -> ActionBatch:
        """Return actions for the last observations; views that the next rollout overwrites."""
        if not self._has_noise:
            self.policy.head.fill_noise(self._noise, self._generator)
            self._has_noise = True
        step = self._steps[engine]
        view, device = self._rollout.views[engine][step], self._device
        on_cpu = device.type == "cpu"
        tensors = view.tensors if on_cpu else as_tensors(view.observation, device)
        mask = as_tensor(view.mask, device) if self._rollout.has_mask else None
        outputs = self.policy.outputs(self.policy.encoder(tensors))
        noise = self._engine_noise[engine][step]
        discrete, continuous = self.policy.head.sample(outputs, noise, mask)
        view.discrete[...] = discrete.cpu().numpy()
        if not self.policy.head.size:
            return ActionBatch(view.discrete, view.continuous)
        view.continuous[...] = continuous.cpu().numpy()
        return ActionBatch(view.discrete, self.policy.head.to_bounds(continuous).cpu().numpy())

    def record(self, engine: int, batch: Batch) -> None:
        """Take the outcome of the last actions, and the observations to act on next."""
        step = self._steps[engine]
        views = self._rollout.views[engine]
        views[step].write_outcome(batch)
        views[step + 1].write_state(batch)
        if len(batch.final_index):
            self._rollout.add_finals(engine, step, batch)
        self._steps[engine] = step + 1

    # --- learning -------------------------------------------------------------------------------

    def update(self, progress: float) -> dict[str, float]:
        """Learn from the rollout, then begin the next where it ended."""
        is_linear = self.config.learning_rate_schedule == "linear"
        share = max(0.0, 1.0 - progress) if is_linear else 1.0
        self._learning_rate = self.config.learning_rate * share
        transitions = self._transitions()
        metrics = self._optimise(transitions) if len(transitions) else {}
        self._take_statistics()
        self._rollout.restart()
        self._has_noise = False
        self._steps = [0] * len(self._steps)
        metrics["learning_rate"] = self._learning_rate
        metrics["num_transitions"] = float(len(transitions))
        if self.policy.head.size:
            metrics["action_std"] = float(self.policy.head.log_std.detach().exp().mean())
        return metrics

    def _optimise(self, transitions: Transitions) -> dict[str, float]:
        """Take gradient steps on the clipped objective, equation 9 of the paper."""
        target_kl, num_epochs = self.config.target_kl, 0
        losses: dict[str, float] = {}
        for _ in range(self.config.epochs):
            steps = [self._gradient_step(part) for part in self._minibatches(transitions)]
            means = to_numbers(torch.stack(steps).mean(0))
            losses = dict(zip(LOSS_METRICS, means, strict=True))
            self._refuse_divergence(losses)
            num_epochs += 1
            if target_kl is not None and losses["approximate_kl"] > target_kl:
                break
        residual = (transitions.target - transitions.value).var(correction=0)
        spread = transitions.target.var(correction=0).clamp(min=1e-12)
        losses["explained_variance"] = float(1 - residual / spread)
        losses["num_epochs"] = float(num_epochs)
        return losses

    def _gradient_step(self, batch: Transitions) -> Tensor:
        """Move the parameters once; return ``LOSS_METRICS``."""
        config = self.config
        features = self.policy.network.features(batch.inputs)
        log_prob, entropy = self.policy.head.evaluate(
            self.policy.network.actor(features), batch.discrete, batch.continuous, batch.mask
        )
        value = self.policy.network.critic(features)
        log_ratio = log_prob - batch.log_prob
        advantage = batch.advantage
        if config.normalise_advantage and len(batch) > 1:
            advantage = (advantage - advantage.mean()) / (advantage.std(correction=0) + 1e-8)

        policy_loss = -clipped_surrogate(log_ratio, advantage, config.clip_range).mean()
        loss_value = value_loss(value, batch.target, batch.value, config.value_clip_range)
        mean_entropy = entropy.mean()
        loss = (
            policy_loss
            + config.value_coefficient * loss_value
            - config.entropy_coefficient * mean_entropy
        )
        self._optimiser.zero_gradients()
        cast(Any, loss).backward()
        grad_norm = self._optimiser.shorten_gradients(config.max_grad_norm)
        self._optimiser.step(self._learning_rate)

        with torch.no_grad():
            kl = approximate_kl(log_ratio)
            is_clipped = (log_ratio.expm1().abs() > config.clip_range).float().mean()
            return torch.stack([policy_loss, loss_value, mean_entropy, kl, is_clipped, grad_norm])

    def _minibatches(self, transitions: Transitions) -> Iterator[Transitions]:
        """Yield all transitions once, in random order, in parts of nearly equal size."""
        order = torch.randperm(len(transitions), generator=self._generator, device=self._device)
        shuffled = transitions.rows(order)
        num_parts = math.ceil(len(order) / self.config.minibatch_size)
        bounds = [len(order) * part // num_parts for part in range(num_parts + 1)]
        for start, stop in itertools.pairwise(bounds):
            yield shuffled.rows(slice(start, stop))

    @torch.no_grad()
    def _transitions(self) -> Transitions:
        """Compute values, log-probabilities and advantages of the rollout; drop inactive slots."""
        rollout, num_steps, device = self._rollout, self._rollout.num_steps, self._device
        inputs = self.policy.encoder(_flat(rollout.observation, device))
        features = self.policy.network.features(inputs)
        value = self.policy.network.critic(features).view(num_steps + 1, -1)
        num_actions = num_steps * rollout.num_agents
        discrete = as_tensor(rollout.discrete, device).flatten(0, 1)
        continuous = as_tensor(rollout.continuous, device).flatten(0, 1)
        mask = None
        if rollout.has_mask:
            mask = as_tensor(rollout.mask[:-1], device).flatten(0, 1)
        outputs = self.policy.network.actor(features[:num_actions])
        log_prob, _ = self.policy.head.evaluate(outputs, discrete, continuous, mask)

        advantage = self._advantage(value)
        value = value[:-1]
        transitions = Transitions(
            inputs.rows(slice(0, num_actions)), discrete, continuous, mask, log_prob,
            value.flatten(), advantage.flatten(), (advantage + value).flatten(),
        )  # fmt: skip
        is_valid = as_tensor(rollout.is_active[:-1], device).flatten()
        return transitions if bool(is_valid.all()) else transitions.rows(is_valid.nonzero()[:, 0])

    def _advantage(self, value: Tensor) -> Tensor:
        """Return ``float32[steps, agents]``, given values ``float32[steps + 1, agents]``.

        A truncated episode goes on, unseen: its next value is that of the final observation, or of
        the last one seen if the engine vanished without giving one.
        """
        rollout, device = self._rollout, self._device
        is_active = as_tensor(rollout.is_active, device)
        terminated, truncated = (
            as_tensor(rollout.terminated, device),
            as_tensor(rollout.truncated, device),
        )
        # A slot that falls silent without an end has no next state to take a value from.
        has_ended = terminated | ~(is_active[1:] | truncated)
        next_value = torch.where(truncated, value[:-1], value[1:])
        finals = rollout.finals()
        if finals is not None:
            inputs = self.policy.encoder(as_tensors(finals.observation, device))
            step, slot = as_tensor(finals.step, device), as_tensor(finals.slot, device)
            next_value[step, slot] = self.policy.value(inputs)
        next_value.masked_fill_(has_ended, 0.0)
        is_done = has_ended | truncated
        reward = as_tensor(rollout.reward, device)
        if self.config.scale_reward:
            reward = self._scaler.scale(reward, is_active[:-1], is_done)
        discounts = (self.config.discount, self.config.gae_lambda)
        return generalised_advantage(reward, value[:-1], next_value, is_done, discounts)

    def _take_statistics(self) -> None:
        if self.policy.encoder.normaliser is None:
            return
        is_active = self._rollout.is_active[:-1]
        seen = {name: array[:-1][is_active] for name, array in self._rollout.observation.items()}
        vectors = self.policy.encoder.join(as_tensors(seen, self._device))
        self.policy.encoder.normaliser.update(vectors)

    def _refuse_divergence(self, losses: dict[str, float]) -> None:
        wrong = [f"{name} is {value}" for name, value in losses.items() if not math.isfinite(value)]
        if wrong:
            raise DivergenceError(
                f"policy {self.policy.spec.name}: {', '.join(wrong)}",
                "look for huge rewards or observations (ludus check reports them), "
                "or lower learning_rate",
            )

    # --- saving ---------------------------------------------------------------------------------

    def state(self) -> LearnerState:
        """Return copies of networks, optimiser, statistics and random stream."""
        tensors = {f"policy.{name}": value for name, value in self.policy.state_dict().items()}
        tensors |= {f"scaler.{name}": value for name, value in self._scaler.state_dict().items()}
        tensors |= {f"optimiser.{name}": value for name, value in self._optimiser.state().items()}
        tensors["generator"] = self._generator.get_state()
        copies = {name: value.detach().cpu().clone() for name, value in tensors.items()}
        return LearnerState(copies, {"algorithm": self.config.algorithm})

    def load_state(self, state: LearnerState) -> None:
        """Go on from ``state``; call :meth:`begin` next."""
        load_tensors(self.policy, state.tensors, "policy.")
        load_tensors(self._scaler, state.tensors, "scaler.")
        names = self._optimiser.state()
        self._optimiser.load_state({name: state.tensors[f"optimiser.{name}"] for name in names})
        self._generator.set_state(state.tensors["generator"])
        self._has_noise = False


def clipped_surrogate(log_ratio: Tensor, advantage: Tensor, clip_range: float) -> Tensor:
    """Return ``L^CLIP``, equation 7: ``min(ratio * A, clip(ratio, 1 - eps, 1 + eps) * A)``."""
    ratio = log_ratio.exp()
    clipped = ratio.clamp(1.0 - clip_range, 1.0 + clip_range)
    return torch.minimum(ratio * advantage, clipped * advantage)


def value_loss(value: Tensor, target: Tensor, old: Tensor, clip_range: float | None) -> Tensor:
    """Return half the mean squared error, with values optionally held near the ``old`` ones."""
    loss = (value - target).square()
    if clip_range is not None:
        held = old + (value - old).clamp(-clip_range, clip_range)
        loss = torch.maximum(loss, (held - target).square())
    return 0.5 * loss.mean()


def approximate_kl(log_ratio: Tensor) -> Tensor:
    """Return the estimator k3 of Schulman, http://joschu.net/blog/kl-approx.html."""
    return (log_ratio.expm1() - log_ratio).mean()


def _flat(observation: dict[str, NDArray[Any]], device: torch.device) -> dict[str, Tensor]:
    """Return ``dtype[steps * agents, *shape]`` of ``dtype[steps, agents, *shape]`` entries."""
    return {
        name: as_tensor(np.reshape(array, (-1, *array.shape[2:])), device)
        for name, array in observation.items()
    }
