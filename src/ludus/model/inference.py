"""Run a policy with NumPy: the reference that every other implementation is compared with."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ludus.errors import UsageError
from ludus.model.checking import check_model
from ludus.model.policy_model import (
    Convolution,
    Gru,
    ImageNetwork,
    Linear,
    Normalisation,
    PolicyModel,
    is_image,
)
from ludus.spec.batch import ActionBatch

__all__ = ["FORBIDDEN", "ModelRunner"]

Array = NDArray[np.float32]

FORBIDDEN = np.float32(-1e8)
"""Logit of a choice that the mask forbids."""


class ModelRunner:
    """Turns observations into actions, for any number of agents at once.

    >>> from ludus.model import ModelRunner, read_model
    >>> runner = ModelRunner(read_model("hero.ludus.json"))           # doctest: +SKIP
    >>> actions, memory = runner.act({"observation": observations})   # doctest: +SKIP

    A policy with a memory needs the state that the last call returned, with the rows of agents
    whose episode has begun set to zero.

    Attributes:
        model: What is run.
        memory_size: Elements of one agent's state; 0 without a memory.
        num_frames: How many observations it takes together.
    """

    def __init__(self, model: PolicyModel) -> None:
        """Check the model.

        Raises:
            PolicyFileError: Its parts do not fit each other.
        """
        check_model(model)
        self.model = model
        self.memory_size = model.memory.size if model.memory is not None else 0
        self.num_frames = model.frames
        self._spec = model.spec
        self._inputs = model.inputs
        self._num_logits = sum(self._spec.nvec)
        self._low, self._high = self._spec.continuous_bounds()

    def act(
        self,
        observation: Mapping[str, NDArray[Any]],
        action_mask: NDArray[np.bool_] | None = None,
        memory: Array | None = None,
        generator: np.random.Generator | None = None,
    ) -> tuple[ActionBatch, Array | None]:
        """Return the actions of ``n`` agents, and their next memory.

        Args:
            observation: Per entry ``dtype[n, *shape]``, all frames of it as in ``model.inputs``.
            action_mask: ``bool[n, sum(nvec)]``, True = allowed; None allows everything.
            memory: ``float32[n, memory_size]``; None begins an episode.
            generator: Draws actions; None takes the most probable ones.

        Returns:
            Actions within the bounds of the spec, and ``float32[n, memory_size]`` or None.

        Raises:
            UsageError: An entry is missing, or an array has the wrong shape.
        """
        outputs, memory = self.outputs(observation, memory)
        discrete = self._choose(outputs[:, : self._num_logits], action_mask, generator)
        return ActionBatch(discrete, self._numbers(outputs, generator)), memory

    def outputs(
        self, observation: Mapping[str, NDArray[Any]], memory: Array | None = None
    ) -> tuple[Array, Array | None]:
        """Return ``float32[n, num_outputs]``, see :class:`Distribution`, and the next memory."""
        x = self._features(observation)
        gru = self.model.memory
        if gru is not None:
            if memory is None:
                memory = np.zeros((len(x), gru.size), np.float32)
            _require_shape("memory", memory, (len(x), gru.size))
            x = memory = _advance_gru(gru, x, memory)
        for layer in self.model.layers:
            x = _apply_linear(layer, x)
        return x, memory

    def _features(self, observation: Mapping[str, NDArray[Any]]) -> Array:
        entries = self._inputs
        for entry in entries:
            if entry.name not in observation:
                raise UsageError(f'there is no entry "{entry.name}" in the observation')
        num = len(observation[entries[0].name])
        for entry in entries:
            name = f'observation["{entry.name}"]'
            _require_shape(name, observation[entry.name], (num, *entry.shape))
        vectors = [observation[entry.name] for entry in entries if not is_image(entry)]
        flat = [vector.reshape(num, -1).astype(np.float32) for vector in vectors]
        joined = np.concatenate([np.zeros((num, 0), np.float32), *flat], axis=1)
        if self.model.normalisation is not None:
            joined = _normalise(self.model.normalisation, joined)
        images = self.model.images
        features = [_image_features(image, observation[image.entry]) for image in images]
        return np.concatenate([joined, *features], axis=1)

    def _choose(
        self,
        logits: Array,
        mask: NDArray[np.bool_] | None,
        generator: np.random.Generator | None,
    ) -> NDArray[np.int64]:
        """Return ``int64[n, num_discrete]``: per component the largest logit, or a draw."""
        if generator is not None:  # The largest of logits with Gumbel noise is a draw of softmax.
            logits = logits + generator.gumbel(size=logits.shape).astype(np.float32)
        if mask is not None:
            _require_shape("action_mask", mask, logits.shape)
            logits = np.where(mask, logits, FORBIDDEN)
        ends = np.cumsum(self._spec.nvec, dtype=np.int64)[:-1]
        chosen = np.zeros((len(logits), self._spec.num_discrete), np.int64)
        if self._num_logits:
            for i, part in enumerate(np.split(logits, ends, axis=1)):
                chosen[:, i] = part.argmax(axis=1)
        return chosen

    def _numbers(self, outputs: Array, generator: np.random.Generator | None) -> Array:
        """Return ``float32[n, continuous_size]`` within the bounds."""
        distribution = self.model.distribution
        end = self._num_logits + self._spec.continuous_size
        unit = outputs[:, self._num_logits : end]
        if generator is not None:
            log_std = distribution.log_std
            if log_std is None:
                log_std = np.clip(outputs[:, end:], *distribution.log_std_range)
            noise = generator.standard_normal(unit.shape, np.float32)
            unit = unit + np.exp(log_std) * noise
        unit = np.tanh(unit) if distribution.is_squashed else np.clip(unit, -1, 1)
        stretched = self._low + (self._high - self._low) * (unit * 0.5 + 0.5)
        return np.clip(stretched, self._low, self._high).astype(np.float32)


def _require_shape(name: str, array: NDArray[Any], shape: tuple[int, ...]) -> None:
    if array.shape != shape:
        raise UsageError(f"{name}: expected shape {list(shape)}, got {list(array.shape)}")


# --- the layers, protocol/POLICY.md §3 ----------------------------------------------------------


def _apply_linear(layer: Linear, x: Array) -> Array:
    """Return ``float32[n, outputs]`` of ``float32[n, inputs]``."""
    return _ACTIVATIONS[layer.activation](x @ layer.weight.T + layer.bias)


def _normalise(normalisation: Normalisation, x: Array) -> Array:
    """Return the joined vector shifted, scaled and cut off, ``float32[n, vector_size]``."""
    shifted = (x - normalisation.shift) * normalisation.scale
    limit = np.float32(normalisation.limit)
    return np.clip(shifted, -limit, limit)


def _advance_gru(gru: Gru, x: Array, state: Array) -> Array:
    """Return the next state, ``float32[n, size]``."""
    input_r, input_z, input_n = _gates(gru.weight_input, gru.bias_input, x)
    state_r, state_z, state_n = _gates(gru.weight_hidden, gru.bias_hidden, state)
    reset, update = _sigmoid(input_r + state_r), _sigmoid(input_z + state_z)
    new: Array = np.tanh(input_n + reset * state_n)
    return np.add(new, update * (state - new))


def _gates(weight: Array, bias: Array, x: Array) -> tuple[Array, Array, Array]:
    """Return what ``x`` adds to the gates reset, update and new, ``float32[n, size]`` each."""
    reset, update, new = np.split(x @ weight.T + bias, 3, axis=1)
    return reset, update, new


def _image_features(network: ImageNetwork, pixels: NDArray[np.uint8]) -> Array:
    """Return ``float32[n, features]`` of ``uint8[n, frames…, height, width, channels]``."""
    x = _channels_first(pixels).astype(np.float32) / np.float32(255)
    for layer in network.convolutions:
        x = _convolve(layer, x)
    return _apply_linear(network.linear, x.reshape(len(x), -1))


def _channels_first(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return ``[n, channels × frames, height, width]``; frames of one channel lie together."""
    num, (height, width, channels) = len(pixels), pixels.shape[-3:]
    frames = pixels.reshape(num, -1, height, width, channels)
    return frames.transpose(0, 4, 1, 2, 3).reshape(num, -1, height, width)


def _convolve(layer: Convolution, x: Array) -> Array:
    padding, stride = layer.padding, layer.stride
    padded = np.pad(x, ((0, 0), (0, 0), (padding, padding), (padding, padding)))
    kernel = layer.weight.shape[2:]
    patches = sliding_window_view(padded, kernel, axis=(2, 3))[:, :, ::stride, ::stride]
    summed = np.tensordot(patches, layer.weight, axes=((1, 4, 5), (1, 2, 3)))
    return _ACTIVATIONS[layer.activation]((summed + layer.bias).transpose(0, 3, 1, 2))


def _sigmoid(x: Array) -> Array:
    return np.tanh(x * np.float32(0.5)) * np.float32(0.5) + np.float32(0.5)


def _elu(x: Array) -> Array:
    return np.where(x > 0, x, np.expm1(np.minimum(x, 0)))


_ACTIVATIONS: dict[str, Callable[[Array], Array]] = {
    "none": lambda x: x,
    "tanh": np.tanh,
    "relu": lambda x: np.maximum(x, 0),
    "elu": _elu,
    "silu": lambda x: x * _sigmoid(x),
}
