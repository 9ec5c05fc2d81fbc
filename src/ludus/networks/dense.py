"""Perceptrons through oneDNN on the CPU, forwards and backwards.

PyTorch multiplies float32 matrices with MKL, which on AMD leaves half of the machine unused: one
thread of an EPYC with AVX-512 did 256x256x256 at 109 GFLOP/s with ``torch.mm`` and at 228 with the
oneDNN that PyTorch brings along and uses for bfloat16 and for convolutions. oneDNN also adds the
bias and applies the activation on the way. A whole perceptron is one node of autograd, as the
bookkeeping per layer would cost as much as a small layer itself.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import torch
from torch import Tensor, nn

__all__ = ["Network", "accelerate"]

Network = Callable[[Tensor], Tensor]
"""From ``float32[n, inputs]`` to ``float32[n, outputs]``."""

MIN_WEIGHTS = 128 * 128
"""Networks whose largest layer has fewer weights than this gain nothing."""

MIN_PRODUCT = 2**21
"""Products of fewer multiplications than this are left to MKL, which starts faster than oneDNN."""

NAMES: dict[type[nn.Module], str] = {nn.ReLU: "relu", nn.Tanh: "tanh"}
"""Activations that oneDNN can apply, and whose gradient follows from their value."""


def accelerate(network: nn.Sequential) -> Network:
    """Return ``network``, or the same function of the same parameters made faster.

    That is so on AMD processors in float32 for large linear layers with ReLU or tanh between them,
    where PyTorch was built with oneDNN.
    """
    linears, activations = list(network)[::2], list(network)[1::2]
    is_known = all(isinstance(layer, nn.Linear) for layer in linears)
    kinds = {type(layer) for layer in activations}
    on_cpu = all(parameter.device.type == "cpu" for parameter in network.parameters())
    is_large = max(parameter.numel() for parameter in network.parameters()) >= MIN_WEIGHTS
    can_do = is_known and on_cpu and len(kinds) == 1 and kinds <= NAMES.keys() and is_worthwhile()
    if not (can_do and is_large):
        return network
    name = NAMES[kinds.pop()]
    parameters = [p for layer in linears for p in (layer.weight, layer.bias)]
    return lambda inputs: cast(Tensor, cast(Any, _Perceptron).apply(inputs, name, *parameters))


@functools.cache
def is_worthwhile() -> bool:
    """Return whether oneDNN can be used, and is faster here than MKL.

    On Intel processors it is not: a gradient step of SAC took 13.5 ms with it and 12.2 ms without.
    """
    cpuinfo = Path("/proc/cpuinfo")  # Linux has the vendor there, Windows in the environment
    text = cpuinfo.read_text(encoding="utf-8") if cpuinfo.exists() else ""
    text += os.environ.get("PROCESSOR_IDENTIFIER", "")
    return "AuthenticAMD" in text and has_onednn()


def has_onednn() -> bool:
    """Return whether PyTorch has oneDNN, and its inner function still does what it does today."""
    if not torch.backends.mkldnn.is_available():
        return False
    inputs, weight, bias = torch.eye(2), torch.tensor([[1.0, -2.0], [3.0, 4.0]]), torch.ones(2)
    try:
        product = cast(Any, torch.ops.mkldnn)._linear_pointwise
        outputs: Tensor = product(inputs, weight, bias, "relu", [], "")
    except (AttributeError, RuntimeError, TypeError):
        return False
    return torch.equal(outputs, torch.tensor([[2.0, 4.0], [0.0, 5.0]]))


class _Perceptron(torch.autograd.Function):
    """Linear layers with one kind of activation between them."""

    @staticmethod
    def forward(ctx: Any, inputs: Tensor, activation: str, *parameters: Tensor) -> Tensor:
        weights, biases = parameters[::2], parameters[1::2]
        layers = [inputs]
        for weight, bias in zip(weights[:-1], biases[:-1], strict=True):
            layers.append(_linear(layers[-1], weight, bias, activation))
        ctx.activation, ctx.num_layers = activation, len(layers)
        ctx.save_for_backward(*layers, *weights)
        return _linear(layers[-1], weights[-1], biases[-1], "none")

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        (gradient,) = gradients
        layers, weights = ctx.saved_tensors[: ctx.num_layers], ctx.saved_tensors[ctx.num_layers :]
        is_learning: bool = ctx.needs_input_grad[2]
        results: list[Tensor | None] = []
        for index in range(ctx.num_layers - 1, -1, -1):
            if is_learning:
                of_weight = _linear(gradient.t(), layers[index].t(), None, "none")
                results[:0] = [of_weight, gradient.sum(0)]
            else:
                results[:0] = [None, None]
            if index or ctx.needs_input_grad[0]:
                gradient = _linear(gradient, weights[index].t(), None, "none")
            if index:
                gradient = _through(gradient, layers[index], ctx.activation)
        of_inputs = gradient if ctx.needs_input_grad[0] else None
        return (of_inputs, None, *results)


def _linear(inputs: Tensor, weight: Tensor, bias: Tensor | None, activation: str) -> Tensor:
    """Return ``activation(inputs weight^T + bias)``."""
    if inputs.numel() * len(weight) >= MIN_PRODUCT:
        product = cast(Any, torch.ops.mkldnn)._linear_pointwise
        return product(inputs, weight, bias, activation, [], "")
    outputs = nn.functional.linear(inputs, weight, bias)
    if activation == "relu":
        return outputs.relu_()
    return outputs.tanh_() if activation == "tanh" else outputs


def _through(gradient: Tensor, outputs: Tensor, activation: str) -> Tensor:
    """Return the gradient before an activation, given that after it and its outputs."""
    aten = cast(Any, torch.ops.aten)
    if activation == "relu":
        return aten.threshold_backward(gradient, outputs, 0)
    return aten.tanh_backward(gradient, outputs)
