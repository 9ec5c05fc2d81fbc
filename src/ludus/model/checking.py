"""Whether the parts of a model fit each other and its spec (protocol/POLICY.md §2)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ludus.errors import PolicyFileError, ProtocolError
from ludus.model.policy_model import (
    Convolution,
    Distribution,
    Gru,
    ImageNetwork,
    Linear,
    Normalisation,
    PolicyModel,
    image_shape,
    is_image,
)
from ludus.spec import Spec
from ludus.wire.spec_reader import read_spec

__all__ = ["MAX_PARAMETERS", "check_model", "mismatch"]

MAX_PARAMETERS = 1 << 25
"""Numbers in all arrays of a model."""
MAX_FRAMES = 256
MAX_LAYERS = 64
MAX_CONVOLUTIONS = 16
MAX_STRIDE = 1 << 16
MAX_ELEMENTS = 1 << 25
"""Numbers in one layer's output."""


def check_model(model: PolicyModel) -> None:
    """Make sure that a model can be run.

    Raises:
        PolicyFileError: Arrays do not fit each other or the spec, or hold NaN or infinity; the
            message names the field.
    """
    _check_spec(model)
    if not 1 <= model.frames <= MAX_FRAMES:
        raise mismatch("frames", f"1 to {MAX_FRAMES}", model.frames)
    _check_normalisation(model.normalisation, model.vector_size)
    _check_images(model)
    size = model.num_features
    if model.memory is not None:
        _check_gru(model.memory, size)
        size = model.memory.size
    _check_distribution(model.distribution, model.spec.continuous_size)
    _check_layers(model, size)
    if (total := _num_parameters(model)) > MAX_PARAMETERS:
        raise PolicyFileError(f"policy file: {total} parameters, the limit is {MAX_PARAMETERS}")


def _check_spec(model: PolicyModel) -> None:
    """Hold the spec to the limits of the protocol, through its reader."""
    try:
        read_spec(Spec(1, "isolated", 1, 1.0, (model.spec,)).to_json())
    except ProtocolError as error:
        what = error.message.removeprefix("spec.policies[0].")
        raise PolicyFileError(f"policy file: {what}") from error


def _check_normalisation(normalisation: Normalisation | None, size: int) -> None:
    if normalisation is None:
        return
    _check_array("normalisation.shift", normalisation.shift, (size,))
    _check_array("normalisation.scale", normalisation.scale, (size,))
    if not (math.isfinite(normalisation.limit) and normalisation.limit > 0.0):
        raise mismatch("normalisation.limit", "a positive number", normalisation.limit)


def _check_images(model: PolicyModel) -> None:
    entries = [entry for entry in model.inputs if is_image(entry)]
    names = [image.entry for image in model.images]
    if names != [entry.name for entry in entries]:
        raise mismatch("images", f"one for each of {[entry.name for entry in entries]}", names)
    for i, (image, entry) in enumerate(zip(model.images, entries, strict=True)):
        _check_image(f"images[{i}]", image, image_shape(entry))


def _check_image(where: str, image: ImageNetwork, shape: tuple[int, int, int]) -> None:
    if not 1 <= len(image.convolutions) <= MAX_CONVOLUTIONS:
        count = len(image.convolutions)
        raise mismatch(f"{where}.convolutions", f"1 to {MAX_CONVOLUTIONS}", count)
    for i, layer in enumerate(image.convolutions):
        shape = _check_convolution(f"{where}.convolutions[{i}]", layer, shape)
    _check_linear(f"{where}.linear", image.linear, math.prod(shape))


def _check_convolution(
    where: str, layer: Convolution, shape: tuple[int, int, int]
) -> tuple[int, int, int]:
    """Return the shape of the output."""
    weight = layer.weight
    if weight.ndim != 4 or weight.shape[1] != shape[0] or 0 in weight.shape:
        expected = f"[filters, {shape[0]}, kernel height, kernel width]"
        raise mismatch(f"{where}.weight.shape", expected, list(weight.shape))
    if not 1 <= layer.stride <= MAX_STRIDE:
        raise mismatch(f"{where}.stride", f"1 to {MAX_STRIDE}", layer.stride)
    if not 0 <= layer.padding < min(weight.shape[2:]):
        raise mismatch(f"{where}.padding", "0 to less than the kernel", layer.padding)
    padded = (side + 2 * layer.padding for side in shape[1:])
    sides = zip(padded, weight.shape[2:], strict=True)
    height, width = ((side - kernel) // layer.stride + 1 for side, kernel in sides)
    output = (len(weight), height, width)
    if min(output) < 1 or math.prod(output) > MAX_ELEMENTS:
        raise mismatch(f"{where}.weight.shape", f"a kernel that fits {list(shape)}", weight.shape)
    _check_array(f"{where}.weight", weight, weight.shape)
    _check_array(f"{where}.bias", layer.bias, weight.shape[:1])
    return output


def _check_gru(memory: Gru, inputs: int) -> None:
    if memory.weight_hidden.ndim != 2 or memory.size < 1:
        shape = list(memory.weight_hidden.shape)
        raise mismatch("memory.weight_hidden.shape", "[3 * size, size]", shape)
    rows = 3 * memory.size
    _check_array("memory.weight_input", memory.weight_input, (rows, inputs))
    _check_array("memory.weight_hidden", memory.weight_hidden, (rows, memory.size))
    _check_array("memory.bias_input", memory.bias_input, (rows,))
    _check_array("memory.bias_hidden", memory.bias_hidden, (rows,))


def _check_distribution(distribution: Distribution, size: int) -> None:
    if distribution.log_std is not None:
        _check_array("distribution.log_std", distribution.log_std, (size,))
    low, high = distribution.log_std_range
    if not (-math.inf < low <= high < math.inf):
        raise mismatch("distribution.log_std_range", "[lowest, highest]", [low, high])


def _check_layers(model: PolicyModel, inputs: int) -> None:
    if not 1 <= len(model.layers) <= MAX_LAYERS:
        raise mismatch("layers", f"1 to {MAX_LAYERS} of them", len(model.layers))
    for i, layer in enumerate(model.layers):
        _check_linear(f"layers[{i}]", layer, inputs)
        inputs = len(layer.bias)
    if inputs != model.num_outputs:
        expected = f"[{model.num_outputs}], as action and distribution ask for"
        raise mismatch(f"layers[{len(model.layers) - 1}].bias.shape", expected, [inputs])


def _check_linear(where: str, layer: Linear, inputs: int) -> None:
    shape = layer.weight.shape
    if len(shape) != 2 or shape[0] < 1 or shape[1] != inputs:
        raise mismatch(f"{where}.weight.shape", f"[outputs, {inputs}]", list(shape))
    _check_array(f"{where}.weight", layer.weight, shape)
    _check_array(f"{where}.bias", layer.bias, shape[:1])


def _check_array(where: str, array: NDArray[np.float32], shape: tuple[int, ...]) -> None:
    if array.shape != shape:
        raise mismatch(f"{where}.shape", f"{list(shape)}", list(array.shape))
    if array.dtype != np.float32:
        raise mismatch(where, "float32", array.dtype)
    if not np.isfinite(array).all():
        index = [int(axis) for axis in np.argwhere(~np.isfinite(array))[0]]
        raise mismatch(f"{where}{index}", "a finite number", array[tuple(index)])


def _num_parameters(model: PolicyModel) -> int:
    layers: list[Linear | Convolution] = [*model.layers, *(image.linear for image in model.images)]
    for image in model.images:
        layers += image.convolutions
    total = sum(layer.weight.size + layer.bias.size for layer in layers)
    memory = model.memory
    if memory is not None:
        total += memory.weight_input.size + memory.weight_hidden.size + 2 * memory.bias_input.size
    return total


def mismatch(where: str, expected: str, got: object) -> PolicyFileError:
    """Return the error that names a field, what was expected there, and what came."""
    return PolicyFileError(
        f"policy file: {where}: expected {expected}, got {got}",
        hint="export the policy again with `ludus export`",
    )
