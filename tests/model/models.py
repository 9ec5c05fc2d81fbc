"""Small policies with random weights of a fixed seed, one of every kind."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from ludus.model.policy_model import (
    Activation,
    Convolution,
    Distribution,
    Gru,
    ImageNetwork,
    Linear,
    Normalisation,
    PolicyModel,
)
from ludus.spec import ActionComponent, ContinuousAction, DiscreteAction, ObservationEntry

Array = np.ndarray[tuple[int, ...], np.dtype[np.float32]]


class Weights:
    """Draws arrays that keep activations near one."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)

    def array(self, *shape: int) -> Array:
        return self._rng.standard_normal(shape, np.float32)

    def scaled(self, *shape: int) -> Array:
        num_inputs = int(np.prod(shape[1:]))
        return (self.array(*shape) / np.sqrt(num_inputs)).astype(np.float32)

    def linear(self, inputs: int, outputs: int, activation: Activation = "none") -> Linear:
        return Linear(self.scaled(outputs, inputs), self.array(outputs) * 0.1, activation)

    def perceptron(self, sizes: Sequence[int], activation: Activation) -> tuple[Linear, ...]:
        hidden = [self.linear(a, b, activation) for a, b in pairwise(sizes[:-1])]
        return (*hidden, self.linear(sizes[-2], sizes[-1]))

    def gru(self, inputs: int, size: int) -> Gru:
        return Gru(
            self.scaled(3 * size, inputs),
            self.scaled(3 * size, size),
            self.array(3 * size) * 0.1,
            self.array(3 * size) * 0.1,
        )

    def normalisation(self, size: int, limit: float = 10.0) -> Normalisation:
        return Normalisation(self.array(size), np.exp(self.array(size)), limit)

    def convolution(self, channels: int, filters: int, kernel: int, **how: int) -> Convolution:
        stride, padding = how.get("stride", 1), how.get("padding", 0)
        weight = self.scaled(filters, channels, kernel, kernel)
        return Convolution(weight, self.array(filters) * 0.1, stride, padding, "relu")


def entry(name: str, *shape: int, dtype: str = "float32") -> ObservationEntry:
    return ObservationEntry(name, dtype, shape)


def model(
    name: str,
    observation: Sequence[ObservationEntry],
    action: Sequence[ActionComponent],
    layers: tuple[Linear, ...],
    distribution: Distribution,
    normalisation: Normalisation | None = None,
    images: tuple[ImageNetwork, ...] = (),
    memory: Gru | None = None,
    has_action_mask: bool = False,
    frames: int = 1,
) -> PolicyModel:
    made = PolicyModel(
        policy=name,
        fingerprint="",
        observation=tuple(observation),
        action=tuple(action),
        has_action_mask=has_action_mask,
        normalisation=normalisation,
        images=images,
        memory=memory,
        layers=layers,
        distribution=distribution,
        frames=frames,
    )
    return replace(made, fingerprint=made.spec.fingerprint())


def log_stds(*values: float) -> Distribution:
    return Distribution(np.array(values, np.float32))


def perceptron(activation: Activation) -> PolicyModel:
    """5 numbers, 7 and 6 units (no multiples of 4), one choice of 3."""
    weights = Weights(["none", "tanh", "relu", "elu", "silu"].index(activation))
    return model(
        f"perceptron_{activation}",
        [entry("observation", 5)],
        [DiscreteAction("push", 3)],
        weights.perceptron((5, 7, 6, 3), activation),
        log_stds(),
        weights.normalisation(5),
    )


def mixed() -> PolicyModel:
    """Entries of every type, choices and numbers in turn, a mask."""
    weights = Weights(10)
    action = [
        ContinuousAction("aim", 2, 0.0, 90.0),
        DiscreteAction("gait", 3),
        ContinuousAction("lean", 1, -0.5, 2.0),
        DiscreteAction("shoot", 2),
    ]
    return model(
        "mixed",
        [entry("rays", 2, 3), entry("near", 4, dtype="uint8"), entry("ammo", 1, dtype="int64")],
        action,
        weights.perceptron((11, 12, 8), "tanh"),
        log_stds(-1.0, -0.5, 0.25),
        weights.normalisation(11, limit=1.5),
        has_action_mask=True,
    )


def squashed() -> PolicyModel:
    """Numbers through tanh, their deviation put out by the network."""
    weights = Weights(11)
    return model(
        "squashed",
        [entry("observation", 6)],
        [ContinuousAction("force", 3, -2.0, 4.0)],
        weights.perceptron((6, 16, 16, 6), "relu"),
        Distribution(None, (-5.0, 0.5), is_squashed=True),
    )


def gru() -> PolicyModel:
    """A memory of 6, then a layer; one choice of 4 and a number."""
    weights = Weights(12)
    return model(
        "gru",
        [entry("observation", 3)],
        [DiscreteAction("turn", 4), ContinuousAction("speed", 1, 0.0, 5.0)],
        weights.perceptron((6, 5, 5), "tanh"),
        log_stds(0.0),
        weights.normalisation(3),
        memory=weights.gru(3, 6),
    )


def camera() -> PolicyModel:
    """Two stacked frames of 12 × 10 × 3 beside two numbers; padding and strides."""
    weights = Weights(13)
    convolutions = (
        weights.convolution(6, 5, 3, stride=2, padding=1),
        weights.convolution(5, 7, 3, stride=2, padding=1),
    )
    image = ImageNetwork("eye", convolutions, weights.linear(7 * 3 * 3, 9, "relu"))
    return model(
        "camera",
        [entry("eye", 2, 12, 10, 3, dtype="uint8"), entry("speed", 2)],
        [DiscreteAction("turn", 3)],
        weights.perceptron((11, 8, 3), "relu"),
        log_stds(),
        weights.normalisation(2),
        images=(image,),
    )


def cameras_with_memory() -> PolicyModel:
    """Two images without any numbers, a wide kernel without padding, a memory, two ranges."""
    weights = Weights(14)
    left = ImageNetwork(
        "left",
        (weights.convolution(1, 4, 4, stride=3),),
        weights.linear(4 * 3 * 2, 6, "relu"),
    )
    right = ImageNetwork(
        "right",
        (weights.convolution(2, 3, 5),),
        weights.linear(3 * 2 * 3, 4, "elu"),
    )
    return model(
        "cameras_with_memory",
        [entry("left", 11, 8, 1, dtype="uint8"), entry("right", 6, 7, 2, dtype="uint8")],
        [ContinuousAction("force", 2, (-1.0, 0.0), (1.0, 90.0))],
        weights.perceptron((5, 2), "tanh"),
        log_stds(0.0, 0.0),
        images=(left, right),
        memory=weights.gru(10, 5),
    )


def frames() -> PolicyModel:
    """The last three observations: two numbers, a table of bytes, an image of two frames."""
    weights = Weights(15)
    eye = ImageNetwork(
        "eye", (weights.convolution(6, 4, 3, stride=2),), weights.linear(4 * 2 * 2, 5, "relu")
    )
    return model(
        "frames",
        [
            entry("speed", 2),
            entry("eye", 2, 5, 6, 1, dtype="uint8"),
            entry("table", 2, 2, dtype="uint8"),
        ],
        [DiscreteAction("turn", 3)],
        weights.perceptron((23, 8, 3), "tanh"),
        log_stds(),
        weights.normalisation(18),
        images=(eye,),
        frames=3,
    )


MODELS: dict[str, Callable[[], PolicyModel]] = {
    "perceptron_none": lambda: perceptron("none"),
    "perceptron_tanh": lambda: perceptron("tanh"),
    "perceptron_relu": lambda: perceptron("relu"),
    "perceptron_elu": lambda: perceptron("elu"),
    "perceptron_silu": lambda: perceptron("silu"),
    "mixed": mixed,
    "squashed": squashed,
    "gru": gru,
    "camera": camera,
    "cameras_with_memory": cameras_with_memory,
    "frames": frames,
}
