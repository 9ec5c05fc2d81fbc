"""A trained policy as plain arrays: what an exported file holds (protocol/POLICY.md).

Nothing here needs PyTorch. :mod:`ludus.model.json_file` writes and reads it as JSON.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ludus.spec import ActionComponent, AgentSpec, ObservationEntry, PolicySpec

__all__ = [
    "Activation",
    "Convolution",
    "Distribution",
    "Gru",
    "ImageNetwork",
    "Linear",
    "Normalisation",
    "PolicyModel",
    "image_shape",
    "is_image",
    "stack_entries",
]

Array = NDArray[np.float32]
Activation = Literal["none", "tanh", "relu", "elu", "silu"]


@dataclass(frozen=True)
class Linear:
    """``y = activation(weight @ x + bias)``.

    Attributes:
        weight: ``float32[outputs, inputs]``.
        bias: ``float32[outputs]``.
        activation: Non-linearity behind it.
    """

    weight: Array
    bias: Array
    activation: Activation


@dataclass(frozen=True)
class Convolution:
    """A two-dimensional cross-correlation with zero padding.

    Attributes:
        weight: ``float32[filters, channels, kernel_height, kernel_width]``.
        bias: ``float32[filters]``.
        stride: Pixels between two applications, both ways.
        padding: Zeros on each side, both ways.
        activation: Non-linearity behind it.
    """

    weight: Array
    bias: Array
    stride: int
    padding: int
    activation: Activation


@dataclass(frozen=True)
class ImageNetwork:
    """Features of one image entry: pixels / 255, convolutions, flat in channel-major order, linear.

    Attributes:
        entry: Name of the observation entry.
        convolutions: In order.
        linear: From the last convolution's output ``[channels, height, width]``, flat.
    """

    entry: str
    convolutions: tuple[Convolution, ...]
    linear: Linear


@dataclass(frozen=True)
class Gru:
    """A gated recurrent unit (Cho et al. 2014), gates in the order reset, update, new.

    ``r = sigmoid(Wi_r x + bi_r + Wh_r h + bh_r)``, ``z`` likewise,
    ``n = tanh(Wi_n x + bi_n + r * (Wh_n h + bh_n))``, ``h' = (1 - z) * n + z * h``.

    Attributes:
        weight_input: ``float32[3 * size, inputs]``.
        weight_hidden: ``float32[3 * size, size]``.
        bias_input: ``float32[3 * size]``.
        bias_hidden: ``float32[3 * size]``.
        kind: The only one there is.
    """

    weight_input: Array
    weight_hidden: Array
    bias_input: Array
    bias_hidden: Array
    kind: Literal["gru"] = "gru"

    @property
    def size(self) -> int:
        """Elements of the state."""
        return self.weight_hidden.shape[1]


@dataclass(frozen=True)
class Normalisation:
    """``clip((x - shift) * scale, -limit, limit)`` of the joined vector.

    Attributes:
        shift: ``float32[vector_size]``.
        scale: ``float32[vector_size]``.
        limit: Cut-off.
    """

    shift: Array
    scale: Array
    limit: float


@dataclass(frozen=True)
class Distribution:
    """How outputs become actions.

    Outputs are the logits of all discrete components, then the means of all continuous elements,
    then, if ``log_std`` is None, their log deviations, cut to ``log_std_range``.

    Attributes:
        log_std: ``float32[continuous_size]``, the same in every state; None: the network's.
        log_std_range: Lowest and highest log deviation, where the network puts them out.
        is_squashed: Whether ``tanh`` brings continuous elements between -1 and 1; otherwise they
            are cut off there. Afterwards they are stretched to the bounds of the action space.
    """

    log_std: Array | None
    log_std_range: tuple[float, float] = (-20.0, 2.0)
    is_squashed: bool = False


@dataclass(frozen=True)
class PolicyModel:
    """A policy to run: observation in, action out.

    The joined vector of all entries but images, in the order of ``observation``, is normalised;
    the features of the images follow it; a memory, if there is one, turns both into its state;
    layers turn that into outputs. With several frames, the last observations of an agent take the
    place of the one it has just made.

    Attributes:
        policy: Name of the policy.
        fingerprint: Hash of the spec it was trained for, :meth:`ludus.spec.PolicySpec.fingerprint`.
        observation: Entries of one observation, in order.
        action: Components of its action, in order.
        has_action_mask: Whether discrete choices may be forbidden.
        normalisation: Of the joined vector; None leaves it.
        images: Networks of the image entries, in the order of ``observation``.
        memory: None without one.
        layers: From features to outputs.
        distribution: From outputs to actions.
        frames: How many observations the network looks at together.
    """

    policy: str
    fingerprint: str
    observation: tuple[ObservationEntry, ...]
    action: tuple[ActionComponent, ...]
    has_action_mask: bool
    normalisation: Normalisation | None
    images: tuple[ImageNetwork, ...]
    memory: Gru | None
    layers: tuple[Linear, ...]
    distribution: Distribution
    frames: int = 1

    @property
    def spec(self) -> PolicySpec:
        """What it can be trained and played as, with one agent."""
        agents = (AgentSpec(0, None),)
        masked = self.has_action_mask
        return PolicySpec(self.policy, self.observation, self.action, agents, 1, masked)

    @property
    def inputs(self) -> tuple[ObservationEntry, ...]:
        """What the network looks at: all frames of each entry."""
        return stack_entries(self.observation, self.frames)

    @property
    def vector_size(self) -> int:
        """Elements of all inputs but images."""
        return sum(entry.size for entry in self.inputs if not is_image(entry))

    @property
    def num_features(self) -> int:
        """Elements of the joined vector and of the features of all images."""
        return self.vector_size + sum(len(image.linear.bias) for image in self.images)

    @property
    def num_outputs(self) -> int:
        """Logits, means and, if they depend on the state, log deviations."""
        size = self.spec.continuous_size
        log_stds = size if self.distribution.log_std is None else 0
        return sum(self.spec.nvec) + size + log_stds


def is_image(entry: ObservationEntry) -> bool:
    """Return whether convolutions look at this entry: ``uint8`` with three or more axes."""
    return entry.dtype == "uint8" and len(entry.shape) >= 3


def image_shape(entry: ObservationEntry) -> tuple[int, int, int]:
    """Return ``(channels, height, width)`` of an image entry, stacked frames among the channels."""
    frames = math.prod(entry.shape[:-3])
    return entry.shape[-1] * frames, entry.shape[-3], entry.shape[-2]


def stack_entries(
    entries: Iterable[ObservationEntry], num_frames: int
) -> tuple[ObservationEntry, ...]:
    """Return what a network looks at that sees several observations, the oldest first.

    Args:
        entries: Of one observation.
        num_frames: How many; 1 leaves the entries as they are.

    Returns:
        Images with the shape ``[num_frames, *shape]``, other entries with ``[num_frames, size]``.
    """
    if num_frames == 1:
        return tuple(entries)
    return tuple(
        replace(
            entry,
            shape=(num_frames, *(entry.shape if is_image(entry) else (entry.size,))),
            low=entry.low * num_frames if isinstance(entry.low, tuple) else entry.low,
            high=entry.high * num_frames if isinstance(entry.high, tuple) else entry.high,
        )
        for entry in entries
    )
