"""A policy: everything that turns observations into actions, and nothing that trains it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from ludus.model.frame_stack import FrameStack
from ludus.model.policy_model import stack_entries
from ludus.networks.distributions import LOG_STD_RANGE, ActionHead, GaussianShape
from ludus.networks.networks import FeatureTorso, Inputs, ObservationEncoder, perceptron
from ludus.networks.own_network import MakeNetwork, OwnTorso
from ludus.networks.tensors import as_tensor, as_tensors
from ludus.settings.policy_config import PolicyConfig, PPOConfig
from ludus.spec import PolicySpec
from ludus.spec.batch import ActionBatch, Batch
from ludus.spec.decision import ActionShape, Decision, describe_outputs

__all__ = ["Player", "Policy"]


class Policy(nn.Module):
    """Actor network, observation statistics and action distribution of one policy.

    Args:
        spec: What it observes and does.
        config: Its settings.
        make_network: Makes the torso; None: Ludus's own.

    Attributes:
        spec: What it observes and does.
        num_frames: How many of its last observations it looks at.
        input_spec: The same with all frames of each entry, as the network takes them.
        encoder: From entries to inputs; holds the observation statistics.
        torso: From inputs to features.
        memory: A recurrent layer over the features, None without one. What it remembers takes
            their place.
        memory_size: Its units, 0 without one.
        actor: From features to what ``head`` makes actions of.
        head: The action distribution.
        critic: From features to the return that it expects, in rewards of the game; None where it
            was not loaded. It is not part of the policy.
    """

    critic: Callable[[Tensor], float] | None = None

    def __init__(
        self, spec: PolicySpec, config: PolicyConfig, make_network: MakeNetwork | None = None
    ) -> None:
        super().__init__()
        self.spec = spec
        self.num_frames = config.frame_stack
        inputs = stack_entries(spec.observation, self.num_frames)
        self.input_spec = replace(spec, observation=inputs)
        self._make_network = make_network
        self.encoder = ObservationEncoder(inputs, config.normalise_observation)
        self.head = ActionHead(spec, _gaussian_shape(config))
        self.torso = self.make_torso()
        self.memory_size = config.memory_size if isinstance(config, PPOConfig) else 0
        self.memory = _gru(self.torso.size, self.memory_size) if self.memory_size else None
        sizes = (self.memory_size or self.torso.size, *config.hidden_sizes, self.head.num_outputs)
        self.actor = perceptron(sizes, config.activation, 0.01)
        last = self.actor[-1]
        assert isinstance(last, nn.Linear)
        self.head.initialise(last)

    @property
    def device(self) -> torch.device:
        """Where it computes."""
        return self.head.low.device

    @property
    def feature_size(self) -> int:
        """Elements of what the actor looks at."""
        return self.memory_size or self.torso.size

    def make_frame_stack(self, num_slots: int) -> FrameStack:
        """Return what makes of the observations of some slots what the network takes."""
        return FrameStack(self.spec.observation, self.num_frames, num_slots)

    def make_torso(self) -> FeatureTorso | OwnTorso:
        """Return another torso like that of the policy, with weights of its own."""
        if self._make_network is None:
            return FeatureTorso(self.encoder)
        return OwnTorso(self._make_network, self.input_spec, self.encoder)

    def features(self, inputs: Inputs) -> Tensor:
        """Return ``float32[n, torso.size]``, what memory or actor look at."""
        return self.torso(inputs)

    def remember(self, features: Tensor, state: Tensor) -> Tensor:
        """Return the next state of the memory, ``float32[n, memory_size]``, from the last one."""
        assert self.memory is not None
        return self.memory(features, state)

    def make_critic(self, config: PPOConfig) -> nn.Sequential:
        """Return PPO's critic, from features to a value; its values begin at exactly 0.

        Until the first reward, random values would be all there is to the advantages; normalised,
        that noise makes the actor nearly deterministic, often before it has reached a reward at
        all.
        """
        hidden = config.critic_hidden_sizes
        hidden = config.hidden_sizes if hidden is None else hidden
        return perceptron((self.feature_size, *hidden, 1), config.activation, 0.0)

    def act_on(self, inputs: Inputs, state: Tensor | None) -> tuple[Tensor, Tensor | None]:
        """Return the actor's outputs, ``float32[n, head.num_outputs]``, and the memory's state."""
        features = self.features(inputs)
        if state is not None:
            features = state = self.remember(features, state)
        return self.actor(features), state


class Player:
    """Plays a policy in a fixed number of slots, and remembers for each.

    Args:
        policy: What to play.
        num_slots: Rows of every batch.
        generator: Draws samples; None takes the most probable actions.
    """

    def __init__(
        self, policy: Policy, num_slots: int, generator: torch.Generator | None = None
    ) -> None:
        self.policy = policy
        self._generator = generator
        self._noise = torch.empty(num_slots, policy.head.num_noise, device=policy.device)
        size = policy.memory_size
        self._state = torch.zeros(num_slots, size, device=policy.device) if size else None
        self._was_active = np.zeros(num_slots, np.bool_)
        self._frames = policy.make_frame_stack(num_slots)
        self._last: tuple[Tensor, Inputs, Batch] | None = None

    @torch.inference_mode()
    def act(self, batch: Batch, rows: NDArray[np.int64] | None = None) -> ActionBatch:
        """Return the action of every slot.

        What a slot remembers is forgotten where ``batch`` says that its episode has ended.

        Args:
            batch: What the slots observe, and what came of their last actions.
            rows: ``int64[m]``, slots to act in; None acts in all.

        Returns:
            Actions of those ``m`` slots.
        """
        policy, device = self.policy, self.policy.device
        batch = self._frames.push_batch(batch)
        chosen: NDArray[np.int64] | slice = slice(None) if rows is None else rows
        observation = {name: array[chosen] for name, array in batch.observation.items()}
        inputs = policy.encoder(as_tensors(observation, device))
        state = self._recall(batch, chosen)
        outputs, state = policy.act_on(inputs, state)
        if self._state is not None and state is not None:
            self._state[chosen] = state
        noise = None
        if self._generator is not None:
            noise = self._noise[: len(outputs)]
            policy.head.fill_noise(noise, self._generator)
        mask = None if batch.action_mask is None else as_tensor(batch.action_mask[chosen], device)
        discrete, continuous = policy.head.sample(outputs, noise, mask)
        self._last = outputs, inputs, batch
        return ActionBatch(discrete.cpu().numpy(), policy.head.to_bounds(continuous).cpu().numpy())

    @torch.inference_mode()
    def describe(self, slot: int) -> Decision:
        """Return how probable the actions of a slot were in the last step, in which all acted."""
        assert self._last is not None
        outputs, inputs, batch = self._last
        head = self.policy.head
        log_std = None if head.log_std is None else head.log_std.cpu().numpy()
        shape = ActionShape(log_std, LOG_STD_RANGE, head.shape.is_squashed)
        mask = None if batch.action_mask is None else batch.action_mask[slot]
        value = None
        if self.policy.critic is not None:
            row = slice(slot, slot + 1)
            state = None if self._state is None else self._state[row]
            features = self.policy.features(inputs.rows(row)) if state is None else state
            value = self.policy.critic(features)
        return describe_outputs(outputs[slot].cpu().numpy(), self.policy.spec, shape, mask, value)

    def _recall(self, batch: Batch, chosen: NDArray[np.int64] | slice) -> Tensor | None:
        """Return what some slots remember of their episodes."""
        if self._state is None:
            return None
        goes_on = self._was_active & ~(batch.terminated | batch.truncated)
        self._was_active[...] = batch.active
        keep = as_tensor(goes_on[chosen], self.policy.device).unsqueeze(1)
        return self._state[chosen] * keep

    def forget(self, rows: NDArray[np.int64] | None = None) -> None:
        """Clear the memory of the slots ``rows``, or of all, whose episodes have ended."""
        chosen = slice(None) if rows is None else rows
        self._was_active[chosen] = False
        self._frames.forget(chosen)


def _gaussian_shape(config: PolicyConfig) -> GaussianShape:
    if isinstance(config, PPOConfig):
        return GaussianShape(config.initial_log_std, config.state_dependent_std, config.squash)
    return GaussianShape(0.0, is_state_dependent=True, is_squashed=True)


def _gru(inputs: int, size: int) -> nn.GRUCell:
    """Return a GRU (Cho et al. 2014) with orthogonal weights and no bias at the start."""
    cell = nn.GRUCell(inputs, size)
    for weight in (cell.weight_ih, cell.weight_hh):
        nn.init.orthogonal_(weight)
    for bias in (cell.bias_ih, cell.bias_hh):
        nn.init.zeros_(bias)
    return cell
