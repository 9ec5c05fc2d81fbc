"""Soft actor-critic (Haarnoja et al. 2018, arXiv:1812.05905), to be read from the top.

Continuous actions are drawn from a Gaussian squashed by tanh; for one discrete choice the
expectation over actions is taken in full (Christodoulou 2019, arXiv:1910.07207). Numbers of
equations are those of the first paper unless it says otherwise.

Each step of all agents makes the learner owe ``updates_per_step`` gradient steps. They are taken
right after actions were sent to the last engine, so that learning and simulation overlap.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, cast

import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from ludus.algorithms.adam import Adam, as_one_vector, learning_rate_at
from ludus.algorithms.learner import NUM_SAMPLES, LearnerSettings, LearnerState, check_finite_losses
from ludus.algorithms.losses import (
    critic_loss,
    discrete_soft_value,
    soft_value,
    squashed_log_prob,
    temperature_loss,
)
from ludus.algorithms.recorder import Recording
from ludus.algorithms.replay import Replay, Sample
from ludus.algorithms.sac_recorder import SACRecorder, in_order
from ludus.algorithms.twin_critic import TwinCritic
from ludus.errors import ConfigError, SequenceError
from ludus.networks.dense import Network, accelerate
from ludus.networks.device import mixed_precision
from ludus.networks.distributions import masked_log_softmax
from ludus.networks.networks import Inputs
from ludus.networks.policy import Policy
from ludus.networks.tensors import (
    join_names,
    load_tensors,
    to_numbers,
    with_prefix,
)
from ludus.settings.policy_config import SACConfig
from ludus.spec import PolicySpec
from ludus.spec.batch import ActionBatch, Batch

__all__ = ["SAC", "Minibatch"]

ADAM_EPSILON = 1e-8
MAX_STEPS_AT_ONCE = 8
"""Gradient steps whose transitions are drawn together."""

DISCRETE_ENTROPY = 0.7
"""Share of the highest entropy that the policy of a discrete choice should keep by default."""

LOSS_METRICS = ("q_loss", "policy_loss", "temperature_loss", "mean_q", "entropy", "temperature")


@dataclass(frozen=True)
class Minibatch:
    """``n`` transitions to learn from.

    Attributes:
        inputs: What was observed.
        next_inputs: What was observed next.
        discrete: ``int64[n, d]``, the action.
        continuous: ``float32[n, c]``, the action in [-1, 1].
        reward: ``float32[n]``, scaled.
        discount: ``float32[n]``, what the next value counts; 0 where the episode terminated.
        mask: ``bool[n, num_logits]``, actions allowed; None without masks.
        next_mask: The same after the action.
        noise: ``float32[2, n, c]``, standard normal, for an action now and one next.
    """

    inputs: Inputs
    next_inputs: Inputs
    discrete: Tensor
    continuous: Tensor
    reward: Tensor
    discount: Tensor
    mask: Tensor | None
    next_mask: Tensor | None
    noise: Tensor

    def rows(self, rows: slice) -> Minibatch:
        """Return a view of some of the transitions."""
        return Minibatch(
            self.inputs.rows(rows),
            self.next_inputs.rows(rows),
            self.discrete[rows],
            self.continuous[rows],
            self.reward[rows],
            self.discount[rows],
            None if self.mask is None else self.mask[rows],
            None if self.next_mask is None else self.next_mask[rows],
            self.noise[:, rows],
        )


class SAC:
    """Trains one policy by SAC; a :class:`~ludus.algorithms.learner.Learner`.

    Raises:
        ConfigError: The policy's action is neither continuous nor one discrete choice.
    """

    def __init__(self, policy: Policy, config: SACConfig, settings: LearnerSettings) -> None:
        check_action(policy.spec)
        self.policy = policy
        self.config = config
        self._device = policy.device
        self._is_mixed = settings.is_mixed
        self._build_networks(settings)
        self._build_temperature()
        self._learning_rate = config.learning_rate
        self._replay = Replay(policy.input_spec, config.replay_capacity)
        acting = copy.deepcopy(policy) if config.sync_steps > 1 else policy
        self.recorder = SACRecorder(acting, settings, self._store)
        self._is_up_to_date = False
        self._generator = torch.Generator(self._device).manual_seed(settings.seed)
        self._replay_generator = torch.Generator().manual_seed(settings.seed + 1)
        self._steps_owed = 0.0
        self._num_recorded = 0
        self._num_unseen = 0
        self._num_gradient_steps = 0
        self._num_summed = 0
        self._sums = torch.zeros(len(LOSS_METRICS), device=self._device)

    def _build_networks(self, settings: LearnerSettings) -> None:
        """Make actor, critics and target critics, each with its parameters in one vector."""
        config, policy = self.config, self.policy
        sizes = config.critic_hidden_sizes
        sizes = config.hidden_sizes if sizes is None else sizes
        num_outputs = policy.head.num_logits or 1
        self._critic = TwinCritic(
            policy.make_torso(), sizes, policy.head.size, num_outputs, config.activation
        )
        self._critic.to(self._device)
        self._target = copy.deepcopy(self._critic).requires_grad_(False)
        self._fixed_critic = copy.deepcopy(self._critic).requires_grad_(False)
        self._actor_optimiser = Adam(policy.parameters(), ADAM_EPSILON)
        self._critic_optimiser = Adam(self._critic.parameters(), ADAM_EPSILON)
        self._target_values = as_one_vector(self._target.parameters())
        # The critic once more in the same memory: gradients flow through it, but not into it.
        shared = zip(self._fixed_critic.parameters(), self._critic.parameters(), strict=True)
        for fixed, parameter in shared:
            fixed.data = parameter.data
        self._actor: Network = policy.actor
        if not settings.is_mixed and not settings.is_compiled:
            self._actor = accelerate(policy.actor)
            for critic in (self._critic, self._target, self._fixed_critic):
                critic.accelerate()
        self._losses_of_critic = _compiled(self._critic_losses, settings.is_compiled)
        self._losses_of_actor = _compiled(self._actor_losses, settings.is_compiled)

    def _build_temperature(self) -> None:
        config, head = self.config, self.policy.head
        is_fixed = config.temperature is not None
        initial = config.temperature if is_fixed else config.initial_temperature
        value = torch.tensor([math.log(cast(float, initial))], device=self._device)
        self._log_temperature = nn.Parameter(value, requires_grad=not is_fixed)
        self._temperature_optimiser = Adam([self._log_temperature], ADAM_EPSILON)
        self._target_entropy = config.target_entropy
        if self._target_entropy is None and head.size:
            self._target_entropy = -float(head.size)

    # --- collecting -----------------------------------------------------------------------------

    @property
    def num_steps_left(self) -> int:
        """Steps of every engine until the next update."""
        return self.config.report_steps - min(self.recorder.steps)

    def begin(self, engine: int, batch: Batch) -> None:
        """Take the first observations of an engine that was reset."""
        self.recorder.begin(engine, batch)
        self._is_up_to_date = False
        self._choose_exploring()

    def act(self, engine: int) -> ActionBatch:
        """Return actions for the last observations; views that the engine's next ones overwrite."""
        if self.recorder.acted[engine] % self.config.sync_steps == 0:
            self._hand_over()
        return self.recorder.act(engine)

    def _hand_over(self) -> None:
        """Let the recorder act with the newest network, if it has an own one that is older."""
        if self.recorder.policy is not self.policy and not self._is_up_to_date:
            self.recorder.policy.load_state_dict(self.policy.state_dict())
            self._is_up_to_date = True

    def record(self, engine: int, batch: Batch) -> None:
        """Take the outcome of the last actions, and the observations to act on next."""
        self.recorder.record(engine, batch)

    def _store(self, fields: Mapping[str, NDArray[Any]]) -> None:
        """Take the transitions of one step of one engine."""
        num_new = self._replay.add(fields)
        self._num_recorded += num_new
        self._num_unseen += num_new
        if self._replay.size >= min(max(1, self.config.learning_starts), self._replay.capacity):
            self._steps_owed += self.config.updates_per_step / len(self.recorder.steps)

    def _choose_exploring(self) -> None:
        self.recorder.is_exploring = self._num_recorded < self.config.learning_starts

    # --- across machines ------------------------------------------------------------------------

    def plan(self) -> int:
        """Return the steps to play now, until the recorders need a newer network."""
        num_done = self.recorder.steps[0] % self.config.sync_steps
        if num_done == 0:
            self._hand_over()
        return min(self.config.sync_steps - num_done, self.num_steps_left)

    def learn_meanwhile(self) -> None:
        """Take the gradient steps that are due, if the recorders have just got a network."""
        if self.recorder.steps[0] % self.config.sync_steps == 0:
            self._learn_owed()

    def put(self, parts: Mapping[range, Recording]) -> None:
        """Take what the recorders on all machines have recorded, by engines."""
        for engine, fields in in_order(parts):
            self._store(fields)
            self.recorder.steps[engine] += 1

    def lose(self, engines: range, num_steps: int) -> None:
        """Note that what some of the engines did is lost."""
        for engine in engines:
            self.recorder.steps[engine] += num_steps

    def forget(self) -> None:
        """Note that every engine was reset elsewhere."""
        self.recorder.forget()
        self._is_up_to_date = False
        self._choose_exploring()

    # --- driven from outside --------------------------------------------------------------------

    def add_transitions(self, transitions: Sample) -> None:
        """Take transitions that were collected elsewhere; :meth:`learn` learns from them."""
        self._replay.add_transitions(transitions)
        self._num_recorded += len(transitions.reward)
        self._num_unseen += len(transitions.reward)

    def learn(self, num_steps: int) -> dict[str, float]:
        """Take as many gradient steps now; return the metrics of :meth:`update` over them.

        Raises:
            SequenceError: There are no transitions yet.
            DivergenceError: A loss became NaN or infinite.
        """
        if not self._replay.size:
            raise SequenceError(
                f"policy {self.policy.spec.name} has no transitions to learn from",
                "call add_transitions first",
            )
        self._steps_owed = float(num_steps)
        return self.update(0.0)

    # --- learning -------------------------------------------------------------------------------

    def learn_while_stepping(self) -> None:
        """Take the gradient steps that are due while engines simulate.

        Only while all engines are in the same step, the first one with the newest network. So what
        an engine does never depends on when another one answers, and a run stays the same to the
        bit when its engines are spread over machines.
        """
        num_steps = max(self.recorder.steps)
        if min(self.recorder.acted) > num_steps and num_steps % self.config.sync_steps == 0:
            self._learn_owed()

    def _learn_owed(self) -> None:
        self._is_up_to_date = False
        self._choose_exploring()
        num_steps = int(self._steps_owed)
        if not num_steps:
            return
        if not self._num_gradient_steps:
            self._update_statistics()
        self._steps_owed -= num_steps
        for batch in self._minibatches(num_steps):
            self._sums += self._gradient_step(batch)
        self._num_gradient_steps += num_steps
        self._num_summed += num_steps

    def update(self, progress: float) -> dict[str, float]:
        """Take the gradient steps that are left; return means since the last update."""
        self._learn_owed()
        self._learning_rate = learning_rate_at(progress, self.config)
        metrics = self._mean_losses()
        metrics["learning_rate"] = self._learning_rate
        metrics["gradient_steps"] = float(self._num_gradient_steps)
        metrics["replay_size"] = float(self._replay.size)
        self._update_statistics()
        self.recorder.restart()
        self._num_summed = 0
        self._sums.zero_()
        return metrics

    def _mean_losses(self) -> dict[str, float]:
        """Return the means since the last update, none without gradient steps.

        A NaN among them is told once, so that the state can be saved for inspection.
        """
        if not self._num_summed:
            return {}
        means = to_numbers(self._sums / self._num_summed)
        losses: dict[str, float] = dict(zip(LOSS_METRICS, means, strict=True))
        self._sums.nan_to_num_(0.0, 0.0, 0.0)
        check_finite_losses(self.policy.spec.name, losses)
        return losses

    def _minibatches(self, num_steps: int) -> Iterator[Minibatch]:
        """Yield as many minibatches, which are drawn, moved and normalised several at once."""
        size = self.config.batch_size
        for done in range(0, num_steps, MAX_STEPS_AT_ONCE):
            num = min(MAX_STEPS_AT_ONCE, num_steps - done)
            batch = self._draw(num * size)
            for step in range(num):
                yield batch if num == 1 else batch.rows(slice(step * size, (step + 1) * size))

    @torch.no_grad()
    def _draw(self, num: int) -> Minibatch:
        sample = self._replay.sample(num, self._replay_generator, self._device)
        noise = torch.randn(
            (2, num, self.policy.head.size), generator=self._generator, device=self._device
        )
        return Minibatch(
            inputs=self.policy.encoder(sample.observation),
            next_inputs=self.policy.encoder(sample.next_observation),
            discrete=sample.discrete,
            continuous=sample.continuous,
            reward=sample.reward * self.config.reward_scale,
            discount=torch.where(sample.is_terminated, 0.0, self.config.discount),
            mask=sample.mask,
            next_mask=sample.next_mask,
            noise=noise,
        )

    def _gradient_step(self, batch: Minibatch) -> Tensor:
        """Move critics, actor, temperature and targets once; return ``LOSS_METRICS``."""
        config = self.config
        temperature = self._log_temperature.detach().exp()
        with mixed_precision(self._device, self._is_mixed):
            q_loss, mean_q = self._losses_of_critic(batch, temperature)
        self._move(q_loss, self._critic_optimiser)
        with mixed_precision(self._device, self._is_mixed):
            policy_loss, loss, entropy = self._losses_of_actor(batch, temperature)
        if config.temperature is None:
            self._move(policy_loss + loss, self._actor_optimiser, self._temperature_optimiser)
        else:
            self._move(policy_loss, self._actor_optimiser)
        # Targets follow by Polyak averaging, algorithm 1: t <- tau q + (1 - tau) t.
        self._target_values.lerp_(self._critic_optimiser.values, config.target_rate)
        parts = (q_loss, policy_loss, loss, mean_q, entropy, temperature.squeeze(0))
        return torch.stack([part.detach() for part in parts])

    def _move(self, loss: Tensor, *optimisers: Adam) -> None:
        """Go down the gradient of ``loss`` with each of ``optimisers``, whose parameters differ."""
        for optimiser in optimisers:
            optimiser.zero_gradients()
        cast(Any, loss).backward()
        for optimiser in optimisers:
            if self.config.max_grad_norm is not None:
                optimiser.clip_grad_norm(self.config.max_grad_norm)
            optimiser.step(self._learning_rate)

    def _critic_losses(self, batch: Minibatch, temperature: Tensor) -> tuple[Tensor, Tensor]:
        """Return the loss of both critics, and the mean of their values."""
        with torch.no_grad():
            value, _ = self._soft_value(
                self._target, batch.next_inputs, batch.noise[1], batch.next_mask, temperature
            )
            target = batch.reward + batch.discount * value  # equation 2
        if self.policy.head.size:
            first, second = self._critic(batch.inputs, batch.continuous)
        else:
            values = self._critic(batch.inputs)
            first, second = (value.gather(1, batch.discrete) for value in values)
        loss = critic_loss(first.squeeze(1), second.squeeze(1), target)
        return loss, first.detach().mean()

    def _actor_losses(self, batch: Minibatch, temperature: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return the losses of actor and temperature, and the mean entropy."""
        value, entropy = self._soft_value(
            self._fixed_critic, batch.inputs, batch.noise[0], batch.mask, temperature
        )
        excess = entropy.detach() - self._entropy_aim(batch.mask)
        # The actor climbs the soft value: equation 7, and equation 12 of the discrete paper.
        return (
            -value.mean(),
            temperature_loss(self._log_temperature, excess),
            entropy.detach().mean(),
        )

    def _soft_value(
        self, critic: TwinCritic, inputs: Inputs, noise: Tensor, mask: Tensor | None, alpha: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Return soft value and entropy of the policy, ``float32[n]`` twice."""
        head = self.policy.head
        outputs = self._actor(self.policy.features(inputs)).float()
        if not head.size:
            log_prob = masked_log_softmax(outputs, mask)
            return discrete_soft_value(torch.minimum(*critic(inputs)), log_prob, alpha)
        mean, log_std = head.gaussian(outputs)
        raw = torch.addcmul(mean, noise, log_std.exp())
        log_prob = squashed_log_prob(raw, noise, log_std)
        q = torch.minimum(*critic(inputs, raw.tanh())).squeeze(1)
        return soft_value(q, log_prob, alpha), -log_prob

    def _entropy_aim(self, mask: Tensor | None) -> Tensor | float:
        """Return the target entropy; by default a share of the highest one that masks allow."""
        if self._target_entropy is not None:
            return self._target_entropy
        if mask is None:
            return DISCRETE_ENTROPY * math.log(self.policy.head.num_logits)
        return DISCRETE_ENTROPY * mask.sum(-1).clamp(min=1).log()

    @torch.no_grad()
    def _update_statistics(self) -> None:
        """Take observations recorded since the last time into the normaliser."""
        encoder = self.policy.encoder
        if encoder.normaliser is not None and self._num_unseen:
            newest = self._replay.newest(self._num_unseen)
            vectors = encoder.join({name: part.to(self._device) for name, part in newest.items()})
            encoder.normaliser.update(vectors)
        self._num_unseen = 0

    # --- saving ---------------------------------------------------------------------------------

    def state(self) -> LearnerState:
        """Return copies of networks, optimisers, statistics, random streams and replay.

        Raises:
            DivergenceError: A loss since the last update was NaN or infinite; but see
                :meth:`_mean_losses`.
        """
        self._mean_losses()
        modules = {name: module.state_dict() for name, module in self._modules().items()}
        optimisers = {name: each.state() for name, each in self._optimisers().items()}
        samples = {"samples": self._replay.newest(NUM_SAMPLES)}
        tensors = join_names({**modules, **optimisers, **samples}, ".")
        tensors["log_temperature"] = self._log_temperature
        tensors["generator"] = self._generator.get_state()
        tensors["replay_generator"] = self._replay_generator.get_state()
        copies = {name: value.detach().cpu().clone() for name, value in tensors.items()}
        values = {
            "steps_owed": self._steps_owed,
            "num_recorded": self._num_recorded,
            "num_unseen": self._num_unseen,
            "gradient_steps": self._num_gradient_steps,
            "updates": self.recorder.number,
        }
        return LearnerState(copies, values, self._replay.state() if self.config.save_replay else {})

    def load_state(self, state: LearnerState) -> None:
        """Go on from ``state``; call :meth:`begin` next.

        Without a replay in it, learning pauses until ``learning_starts`` new transitions are there.
        """
        tensors, values = state.tensors, state.values
        for name, module in self._modules().items():
            load_tensors(module, tensors, f"{name}.")
        for name, optimiser in self._optimisers().items():
            optimiser.load_state(with_prefix(tensors, f"{name}."))
        if self.config.temperature is None:
            self._log_temperature.data.copy_(tensors["log_temperature"])
        self._generator.set_state(tensors["generator"])
        self._replay_generator.set_state(tensors["replay_generator"])
        if state.replay:
            self._replay.load_state(state.replay)
        self._steps_owed = float(values["steps_owed"]) if state.replay else 0.0
        self._num_recorded = int(values["num_recorded"])
        self._num_unseen = int(values["num_unseen"]) if state.replay else 0
        self._num_gradient_steps = int(values["gradient_steps"])
        self.recorder.number = int(values.get("updates", 0))

    def _modules(self) -> dict[str, nn.Module]:
        return {"policy": self.policy, "critic": self._critic, "target": self._target}

    def _optimisers(self) -> dict[str, Adam]:
        return {
            "actor_optimiser": self._actor_optimiser,
            "critic_optimiser": self._critic_optimiser,
            "temperature_optimiser": self._temperature_optimiser,
        }


def check_action(spec: PolicySpec) -> None:
    """Refuse actions that SAC does not support.

    Raises:
        ConfigError: The action is neither continuous nor one discrete choice.
    """
    if spec.num_discrete == 0 or (spec.num_discrete == 1 and not spec.continuous_size):
        return
    raise ConfigError(
        f"policy {spec.name}: sac needs continuous actions or one discrete choice, not "
        f"{spec.num_discrete} discrete and {spec.continuous_size} continuous",
        "set the policy's algorithm to ppo, which supports all actions",
    )


def _compiled(function: Callable[..., Any], is_compiled: bool) -> Callable[..., Any]:
    return cast(Any, torch).compile(function) if is_compiled else function
