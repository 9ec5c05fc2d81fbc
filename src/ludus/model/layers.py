"""The arithmetic of a policy's layers on float32 batches (protocol/POLICY.md §3)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ludus.model.policy_model import Convolution, Gru, ImageNetwork, Linear, Normalisation

__all__ = ["advance_gru", "apply_linear", "image_features", "normalise"]

Array = NDArray[np.float32]


def apply_linear(layer: Linear, x: Array) -> Array:
    """Return ``float32[n, outputs]`` of ``float32[n, inputs]``."""
    return _ACTIVATIONS[layer.activation](x @ layer.weight.T + layer.bias)


def normalise(normalisation: Normalisation, x: Array) -> Array:
    """Return the joined vector shifted, scaled and cut off, ``float32[n, vector_size]``."""
    shifted = (x - normalisation.shift) * normalisation.scale
    limit = np.float32(normalisation.limit)
    return np.clip(shifted, -limit, limit)


def advance_gru(gru: Gru, x: Array, state: Array) -> Array:
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


def image_features(network: ImageNetwork, pixels: NDArray[np.uint8]) -> Array:
    """Return ``float32[n, features]`` of ``uint8[n, frames…, height, width, channels]``."""
    x = _channels_first(pixels).astype(np.float32) / np.float32(255)
    for layer in network.convolutions:
        x = _convolve(layer, x)
    return apply_linear(network.linear, x.reshape(len(x), -1))


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
