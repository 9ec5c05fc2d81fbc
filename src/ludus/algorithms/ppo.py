"""Proximal policy optimisation (Schulman et al. 2017, arXiv:1707.06347), to be read from the top.

A rollout of ``rollout_steps`` steps of all agents is collected with one network. Nothing but
actions is computed meanwhile: log-probabilities and values of the whole rollout are computed in
one batch when it is complete, which keeps each step short. Observation statistics change after
the update, so that both see the same numbers.

With ``overlap`` the gradient steps on one rollout are taken one by one while engines simulate the
next, which a copy of the network as it was before collects.

Until a reward other than 0 has been seen, the critic's errors are all there is to the advantages,
and normalised they look like any others. So the actor stays as it is until then, but for what
``curiosity`` makes of it.
"""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from ludus.algorithms.adam import Adam, learning_rate_at
from ludus.algorithms.curiosity import Curiosity
from ludus.algorithms.learner import NUM_SAMPLES, LearnerSettings, LearnerState, check_finite_losses
from ludus.algorithms.losses import (
    approximate_kl,
    clipped_surrogate,
    generalised_advantage,
    value_loss,
)
from ludus.algorithms.ppo_gradient import LOSSES, PPOGradient
from ludus.algorithms.ppo_recorder import PPORecorder
from ludus.algorithms.recorder import Recording
from ludus.algorithms.recurrence import Sequences, cut_into_sequences, run_memory
from ludus.algorithms.transitions import Transitions, equal_parts
from ludus.networks.closed_form import PerceptronGradient
from ludus.networks.device import mixed_precision
from ludus.networks.networks import Inputs
from ludus.networks.normalise import RewardScaler
from ludus.networks.policy import Policy
from ludus.networks.tensors import (
    as_tensor,
    as_tensors,
    join_names,
    load_tensors,
    take_rows,
    to_numbers,
    with_prefix,
)
from ludus.settings.policy_config import PPOConfig
from ludus.spec.batch import ActionBatch, Batch

__all__ = ["PPO"]

ADAM_EPSILON = 1e-5
LOSS_METRICS = (*LOSSES, "grad_norm")


class PPO:
    """Trains one policy by PPO; a :class:`~ludus.algorithms.learner.Learner`."""

    def __init__(self, policy: Policy, config: PPOConfig, settings: LearnerSettings) -> None:
        self.policy = policy
        self.config = config
        self._device = policy.device
        self._is_mixed = settings.is_mixed
        self._critic = policy.make_critic(config).to(self._device)
        parameters = itertools.chain(policy.parameters(), self._critic.parameters())
        self._optimiser = Adam(parameters, ADAM_EPSILON)
        can_do = PPOGradient.can_do(policy, self._critic, settings)
        self._gradient = PPOGradient(policy, self._critic) if can_do else None
        self._forward = cast(
            Callable[[Inputs, Sequences | None], tuple[Tensor, Tensor]],
            cast(Any, torch).compile(self._outputs) if settings.is_compiled else self._outputs,
        )
        self._learning_rate = config.learning_rate
        self.recorder = PPORecorder(
            copy.deepcopy(policy) if config.overlap else policy, config, settings
        )
        self._rollout = self.recorder.rollout
        num_agents = self._rollout.num_agents
        self._scaler = RewardScaler(num_agents, config.discount).to(self._device)
        self._curiosity = Curiosity(policy, config, num_agents) if config.curiosity else None
        self._generator = torch.Generator(self._device).manual_seed(settings.seed)
        self._pending: Iterator[None] = iter(())
        self._steps_per_call = 0.0
        self._steps_owed = 0.0
        self._has_seen_reward = False
        self._losses: dict[str, float] = {}
        self._samples: dict[str, Tensor] = {}
        self._imitation = settings.imitation

    # --- collecting -----------------------------------------------------------------------------

    @property
    def num_steps_left(self) -> int:
        """Steps of every engine until the next update."""
        return self.recorder.num_steps_left

    def begin(self, engine: int, batch: Batch) -> None:
        """Take the first observations of an engine that was reset; drops unfinished rollouts."""
        self._forget_returns()
        self.recorder.begin(engine, batch)

    def act(self, engine: int) -> ActionBatch:
        """Return actions for the last observations; views that the next rollout overwrites."""
        return self.recorder.act(engine)

    def record(self, engine: int, batch: Batch) -> None:
        """Take the outcome of the last actions, and the observations to act on next."""
        self.recorder.record(engine, batch)

    # --- across machines ------------------------------------------------------------------------

    def plan(self) -> int:
        """Return the steps to play now: the rest of the rollout."""
        return self.num_steps_left

    def learn_meanwhile(self) -> None:
        """Take the gradient steps that are left of the rollout before; only with ``overlap``."""
        self._finish()

    def put(self, parts: Mapping[range, Recording]) -> None:
        """Take what the recorders on all machines have recorded, by engines."""
        for engines, part in parts.items():
            self.recorder.put(engines, part)

    def lose(self, engines: range, num_steps: int) -> None:
        """Note that what some of the engines did is lost; their slots count as inactive."""
        self.recorder.lose(engines, num_steps)

    def forget(self) -> None:
        """Note that every engine was reset elsewhere."""
        self._forget_returns()
        self.recorder.forget()

    def _forget_returns(self) -> None:
        self._scaler.forget()
        if self._curiosity is not None:
            self._curiosity.forget()

    # --- learning -------------------------------------------------------------------------------

    def update(self, progress: float) -> dict[str, float]:
        """Learn from the rollout, then begin the next where it ended.

        With ``overlap``, finish learning from the rollout before instead, and leave this one to
        :meth:`learn_while_stepping`.
        """
        self._finish()
        losses, self._losses = self._losses, {}
        self._learning_rate = learning_rate_at(progress, self.config)
        transitions = self._transitions()
        self._take_samples()
        if self.config.overlap:
            self.recorder.policy.load_state_dict(self.policy.state_dict())
            # A copy: the next rollout overwrites the arrays of this one.
            every = torch.arange(len(transitions), device=self._device)
            transitions = replace(transitions.rows(every), sequences=transitions.sequences)
        num_transitions = len(take_rows(transitions.value, transitions.valid_rows))
        if num_transitions:
            self._pending = self._optimise(transitions)
            num_parts = math.ceil(len(transitions) / self.config.minibatch_size)
            num_calls = self.config.rollout_steps * len(self.recorder.steps)
            self._steps_per_call = self.config.epochs * num_parts / num_calls
            self._steps_owed = 0.0
        if not self.config.overlap:
            self._finish()
            losses, self._losses = self._losses, {}
        if self._curiosity is not None:
            losses["novelty"] = self._curiosity.learn(
                self.config, self._learning_rate, self._generator
            )
        self._update_statistics()
        self.recorder.restart()
        losses["learning_rate"] = self._learning_rate
        losses["num_transitions"] = float(num_transitions)
        losses["has_reward"] = float(self._has_seen_reward)
        if self.policy.head.log_std is not None and self.policy.head.size:
            losses["action_std"] = float(self.policy.head.log_std.detach().exp().mean())
        return losses

    def learn_while_stepping(self) -> None:
        """Take the gradient steps that are due while engines simulate; only with ``overlap``."""
        self._steps_owed += self._steps_per_call
        while self._steps_owed >= 1.0:
            self._steps_owed -= 1.0
            next(self._pending, None)

    def _finish(self) -> None:
        for _ in self._pending:
            pass

    def _optimise(self, transitions: Transitions) -> Iterator[None]:
        """Take gradient steps on the clipped objective, equation 9 of the paper, one at a time."""
        target_kl, num_epochs = self.config.target_kl, 0
        losses: dict[str, float] = {}
        if self._imitation is not None:
            self._imitation.begin_update(self.policy)
        for _ in range(self.config.epochs):
            steps: list[Tensor] = []
            for part in self._minibatches(transitions):
                steps.append(self._gradient_step(part))
                yield
            means = to_numbers(torch.stack(steps).mean(0))
            losses = dict(zip(LOSS_METRICS, means, strict=True))
            check_finite_losses(self.policy.spec.name, losses)
            num_epochs += 1
            if target_kl is not None and losses["approximate_kl"] > target_kl:
                break
        target = take_rows(transitions.target, transitions.valid_rows)
        residual = (target - take_rows(transitions.value, transitions.valid_rows)).var(correction=0)
        spread = target.var(correction=0).clamp(min=1e-12)
        losses["explained_variance"] = float(1 - residual / spread)
        losses["num_epochs"] = float(num_epochs)
        if self._imitation is not None:
            losses |= self._imitation.end_update()
        self._losses = losses

    def _gradient_step(self, batch: Transitions) -> Tensor:
        """Move the parameters once; return ``LOSS_METRICS``."""
        config = self.config
        # Without a reward, the entropy term would widen a Gaussian without bound.
        has_signal = self._has_seen_reward or self._curiosity is not None
        entropy_coefficient = config.entropy_coefficient if has_signal else 0.0
        self._optimiser.zero_gradients()
        if self._gradient is not None:
            advantage = self._normalised(batch.advantage)
            losses = self._gradient.add(batch, advantage, entropy_coefficient, config)
        else:
            losses = self._add_gradient(batch, entropy_coefficient)
        grad_norm = self._optimiser.clip_grad_norm(config.max_grad_norm)
        self._optimiser.step(self._learning_rate)
        return torch.cat([losses, grad_norm.unsqueeze(0)])

    def _add_gradient(self, batch: Transitions, entropy_coefficient: float) -> Tensor:
        """Compute the gradient by autograd; return ``LOSSES``."""
        config = self.config
        with mixed_precision(self._device, self._is_mixed):
            outputs, value = self._forward(batch.inputs, batch.sequences)
        outputs, value = outputs.float(), value.float()
        if batch.sequences is not None:
            is_valid = batch.sequences.is_valid
            outputs, value, batch = outputs[is_valid], value[is_valid], batch.rows(is_valid)
        log_prob, entropy = self.policy.head.evaluate(
            outputs, batch.discrete, batch.continuous, batch.mask
        )
        log_ratio, advantage = log_prob - batch.log_prob, self._normalised(batch.advantage)
        policy_loss = -clipped_surrogate(log_ratio, advantage, config.clip_range).mean()
        loss_value = value_loss(value, batch.target, batch.value, config.value_clip_range)
        mean_entropy = entropy.mean()
        loss = (
            policy_loss + config.value_coefficient * loss_value - entropy_coefficient * mean_entropy
        )
        if self._imitation is not None:
            loss = loss + self._imitation.penalty(self.policy, self._generator)
        cast(Any, loss).backward()
        with torch.no_grad():
            kl = approximate_kl(log_ratio)
            is_clipped = (log_ratio.expm1().abs() > config.clip_range).float().mean()
            return torch.stack([policy_loss, loss_value, mean_entropy, kl, is_clipped])

    def _normalised(self, advantage: Tensor) -> Tensor:
        """Return the advantages of one minibatch as the policy's loss takes them."""
        if not self.config.normalise_advantage or len(advantage) < 2:
            return advantage
        variance, mean = torch.var_mean(advantage, correction=0)
        return (advantage - mean) / (variance.sqrt() + 1e-8)

    def _outputs(self, inputs: Inputs, sequences: Sequences | None) -> tuple[Tensor, Tensor]:
        """Return the actor's outputs and the values of some transitions."""
        features = self.policy.features(inputs)
        if sequences is not None:
            features = run_memory(self.policy, features, sequences.start, sequences.keep)[1]
        return self.policy.actor(features), self.value(features)

    def value(self, features: Tensor) -> Tensor:
        """Return the critic's values, ``float32[n]``, in the units of scaled rewards."""
        return self._run(self._critic, features).squeeze(-1)

    def _run(self, network: nn.Sequential, features: Tensor) -> Tensor:
        """Return the outputs of actor or critic, as gradient steps will compute them again."""
        if self._gradient is None:
            return network(features)
        return PerceptronGradient(network).forward(features)

    def _minibatches(self, transitions: Transitions) -> Iterator[Transitions]:
        """Yield all transitions once, in random order, in parts of nearly equal size."""
        if transitions.sequences is not None:
            yield from self._sequence_minibatches(transitions, transitions.sequences)
            return
        order = torch.randperm(len(transitions), generator=self._generator, device=self._device)
        shuffled = transitions.rows(order)
        num_parts = math.ceil(len(order) / self.config.minibatch_size)
        for part in equal_parts(len(order), num_parts):
            yield shuffled.rows(part)

    def _sequence_minibatches(
        self, transitions: Transitions, sequences: Sequences
    ) -> Iterator[Transitions]:
        """Yield all sequences once, in random order; steps of a sequence stay together."""
        order = torch.randperm(len(sequences), generator=self._generator, device=self._device)
        num_parts = math.ceil(len(transitions) / self.config.minibatch_size)
        for part in equal_parts(len(order), min(num_parts, len(order))):
            chosen = sequences.choose(order[part])
            if bool(chosen.is_valid.any()):
                yield replace(transitions.rows(chosen.rows), sequences=chosen)

    @torch.no_grad()
    def _transitions(self) -> Transitions:
        """Compute values, log-probabilities and advantages of the rollout; drop inactive slots."""
        rollout, num_steps, device = self._rollout, self._rollout.num_steps, self._device
        self._has_seen_reward = self._has_seen_reward or rollout.has_reward
        inputs = self.recorder.policy.encoder(_flat(rollout.observation, device))
        features = self.recorder.policy.features(inputs)
        states = before = None
        if self.policy.memory_size:
            keep = self._keep()
            states, features = run_memory(
                self.recorder.policy, features, self.recorder.first_memory, keep
            )
            before = torch.cat([self.recorder.first_memory.unsqueeze(0), states[:-1]])
        value = self.value(features).view(num_steps + 1, -1)
        num_actions = num_steps * rollout.num_agents
        discrete = as_tensor(rollout.discrete, device).flatten(0, 1)
        continuous = as_tensor(rollout.continuous, device).flatten(0, 1)
        mask = None
        if rollout.has_mask:
            mask = as_tensor(rollout.mask[:-1], device).flatten(0, 1)
        outputs = self._run(self.recorder.policy.actor, features[:num_actions])
        log_prob, _ = self.policy.head.evaluate(outputs, discrete, continuous, mask)

        advantage = self._advantage(value, states)
        value = value[:-1]
        target = advantage + value
        if not self._has_seen_reward:
            advantage = torch.zeros_like(advantage)
        if self._curiosity is not None:
            is_active = as_tensor(rollout.is_active, device)
            bonus = self._curiosity.advantage(inputs, is_active, self.config)
            advantage = torch.add(advantage, bonus, alpha=self.config.curiosity)
        transitions = Transitions(
            inputs.rows(slice(0, num_actions)), discrete, continuous, mask, log_prob,
            value.flatten(), advantage.flatten(), target.flatten(),
        )  # fmt: skip
        is_valid = as_tensor(rollout.is_active[:-1], device)
        if before is not None:
            length = min(self.config.sequence_length, num_steps)
            sequences = cut_into_sequences(before[:-1], self._keep()[:-1], is_valid, length)
            return replace(transitions, sequences=sequences)
        is_valid = is_valid.flatten()
        return transitions if bool(is_valid.all()) else transitions.rows(is_valid.nonzero()[:, 0])

    def _keep(self) -> Tensor:
        """Return ``bool[steps + 1, agents]``, whether a slot remembers the step before."""
        rollout = self._rollout
        goes_on = rollout.is_active[:-1] & ~(rollout.terminated | rollout.truncated)
        first = np.ones((1, rollout.num_agents), np.bool_)  # forgotten already, where it must be
        return as_tensor(np.concatenate([first, goes_on]), self._device)

    def _advantage(self, value: Tensor, states: Tensor | None) -> Tensor:
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
            inputs = self.recorder.policy.encoder(as_tensors(finals.observation, device))
            step, slot = as_tensor(finals.step, device), as_tensor(finals.slot, device)
            features = self.recorder.policy.features(inputs)
            if states is not None:
                features = self.recorder.policy.remember(features, states[step, slot])
            next_value[step, slot] = self.value(features)
        next_value.masked_fill_(has_ended, 0.0)
        is_done = has_ended | truncated
        reward = as_tensor(rollout.reward, device)
        if self.config.scale_reward:
            reward = self._scaler.scale(reward, is_active[:-1], is_done)
        discounts = (self.config.discount, self.config.gae_lambda)
        return generalised_advantage(reward, value[:-1], next_value, is_done, discounts)

    def _update_statistics(self) -> None:
        for policy in {id(each): each for each in (self.policy, self.recorder.policy)}.values():
            if policy.encoder.normaliser is None:
                return
            is_active = self._rollout.is_active[:-1]
            seen = {
                name: array[:-1][is_active] for name, array in self._rollout.observation.items()
            }
            policy.encoder.normaliser.update(policy.encoder.join(as_tensors(seen, self._device)))

    def _take_samples(self) -> None:
        """Keep some of what was observed, for the parity test of exported policies."""
        flat = {name: array[:-1].reshape(-1, *array.shape[2:])
                for name, array in self._rollout.observation.items()}  # fmt: skip
        is_active = self._rollout.is_active[:-1].reshape(-1).nonzero()[0]
        chosen = is_active[:: max(1, len(is_active) // NUM_SAMPLES)][:NUM_SAMPLES]
        self._samples = {name: as_tensor(array[chosen]).clone() for name, array in flat.items()}

    # --- saving ---------------------------------------------------------------------------------

    def state(self) -> LearnerState:
        """Return copies of networks, optimiser, statistics and random stream.

        With ``overlap``, takes the gradient steps that are left first.
        """
        self._finish()
        parts: dict[str, dict[str, Tensor]] = {
            "policy": self.policy.state_dict(),
            "critic": self._critic.state_dict(),
            "scaler": self._scaler.state_dict(),
            "optimiser": self._optimiser.state(),
            "samples": self._samples,
        }
        if self.config.overlap:
            parts["collector"] = self.recorder.policy.state_dict()
        if self._curiosity is not None:
            parts["curiosity"] = self._curiosity.state()
        tensors = join_names(parts, ".") | {"generator": self._generator.get_state()}
        copies = {name: value.detach().cpu().clone() for name, value in tensors.items()}
        values = {
            "losses": self._losses,
            "rollouts": self.recorder.number,
            "has_seen_reward": self._has_seen_reward,
        }
        if self._imitation is not None:
            values["imitated_updates"] = self._imitation.num_updates
        return LearnerState(copies, values)

    def load_state(self, state: LearnerState) -> None:
        """Go on from ``state``; call :meth:`begin` next."""
        load_tensors(self.policy, state.tensors, "policy.")
        load_tensors(self._critic, state.tensors, "critic.")
        load_tensors(self._scaler, state.tensors, "scaler.")
        if self.config.overlap:
            is_saved = any(name.startswith("collector.") for name in state.tensors)
            load_tensors(
                self.recorder.policy, state.tensors, "collector." if is_saved else "policy."
            )
        self._optimiser.load_state(with_prefix(state.tensors, "optimiser."))
        if self._curiosity is not None:
            self._curiosity.load_state(with_prefix(state.tensors, "curiosity."))
        self._generator.set_state(state.tensors["generator"])
        self._losses = dict(state.values.get("losses", {}))
        self.recorder.number = int(state.values.get("rollouts", 0))
        self._has_seen_reward = bool(state.values.get("has_seen_reward", True))
        if self._imitation is not None:
            self._imitation.num_updates = int(state.values.get("imitated_updates", 0))


def _flat(observation: dict[str, NDArray[Any]], device: torch.device) -> dict[str, Tensor]:
    """Return ``dtype[steps * agents, *shape]`` of ``dtype[steps, agents, *shape]`` entries."""
    return {
        name: as_tensor(np.reshape(array, (-1, *array.shape[2:])), device)
        for name, array in observation.items()
    }
