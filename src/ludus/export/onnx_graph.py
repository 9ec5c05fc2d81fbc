"""ONNX nodes for the parts of a policy: layers, convolutions, memory, activations."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from onnx import NodeProto, TensorProto, helper, numpy_helper

from ludus.model.policy_model import Activation, Convolution, Gru, ImageNetwork, Linear

__all__ = ["OnnxGraph"]

OPERATORS: dict[Activation, str] = {"tanh": "Tanh", "relu": "Relu", "elu": "Elu"}
"""Activations that are one ONNX operator."""


class OnnxGraph:
    """Nodes and constants of a graph that is being built; values go by their names.

    Attributes:
        nodes: In the order of computation.
        constants: Weights and other constants.
    """

    def __init__(self) -> None:
        self.nodes: list[NodeProto] = []
        self.constants: list[TensorProto] = []

    def add(self, operator: str, *inputs: str, **attributes: Any) -> str:
        """Append a node with one output; return the name of that."""
        output = f"ludus/{operator.lower()}_{len(self.nodes)}"
        self.nodes.append(helper.make_node(operator, inputs, [output], **attributes))
        return output

    def name_output(self, value: str, name: str) -> None:
        """Let an output of the graph be ``value``."""
        self.nodes.append(helper.make_node("Identity", [value], [name]))

    def constant(self, array: NDArray[Any], stem: str = "constant") -> str:
        """Store an array; return its name."""
        name = f"ludus/{stem}_{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(np.ascontiguousarray(array), name))
        return name

    def number(self, value: float) -> str:
        """Store ``float32[]``; return its name."""
        return self.constant(np.asarray(value, np.float32))

    def reshape(self, value: str, shape: tuple[int, ...]) -> str:
        """Give ``value`` another shape; its first axis, the agents, stays."""
        return self.add("Reshape", value, self.constant(np.asarray((-1, *shape), np.int64)))

    def columns(self, value: str, start: int, stop: int) -> str:
        """Return ``value[:, start:stop]``."""
        bounds = [self.constant(np.asarray([number], np.int64)) for number in (start, stop, 1)]
        return self.add("Slice", value, *bounds)

    def clip(self, value: str, low: float, high: float) -> str:
        """Cut ``value`` off at both ends."""
        return self.add("Clip", value, self.number(low), self.number(high))

    def joined(self, values: list[str]) -> str:
        """Put matrices side by side."""
        return values[0] if len(values) == 1 else self.add("Concat", *values, axis=1)

    def linear(self, value: str, layer: Linear) -> str:
        """Apply one layer to ``float32[n, inputs]``."""
        product = self._product(value, layer.weight, layer.bias)
        return self._activation(product, layer.activation)

    def image_network(self, pixels: str, shape: tuple[int, ...], network: ImageNetwork) -> str:
        """Turn ``uint8[n, frames…, height, width, channels]`` into features.

        Args:
            pixels: The observation entry.
            shape: Its shape for one agent.
            network: What to apply.
        """
        value = self._channels_first(self.add("Cast", pixels, to=TensorProto.FLOAT), shape)
        value = self.add("Div", value, self.number(255.0))
        for layer in network.convolutions:
            value = self._convolution(value, layer)
        return self.linear(self.add("Flatten", value, axis=1), network.linear)

    def gru(self, value: str, state: str, memory: Gru) -> str:
        """Return the next state, ``float32[n, size]``."""
        from_input = self._product(value, memory.weight_input, memory.bias_input)
        from_state = self._product(state, memory.weight_hidden, memory.bias_hidden)
        reset_i, update_i, new_i = self._thirds(from_input, memory.size)
        reset_h, update_h, new_h = self._thirds(from_state, memory.size)
        reset = self.add("Sigmoid", self.add("Add", reset_i, reset_h))
        update = self.add("Sigmoid", self.add("Add", update_i, update_h))
        new = self.add("Tanh", self.add("Add", new_i, self.add("Mul", reset, new_h)))
        change = self.add("Mul", update, self.add("Sub", state, new))
        return self.add("Add", new, change)

    def _product(self, value: str, weight: NDArray[np.float32], bias: NDArray[np.float32]) -> str:
        names = self.constant(weight, "weight"), self.constant(bias, "bias")
        return self.add("Gemm", value, *names, transB=1)

    def _thirds(self, value: str, size: int) -> list[str]:
        return [self.columns(value, part * size, (part + 1) * size) for part in range(3)]

    def _convolution(self, value: str, layer: Convolution) -> str:
        names = self.constant(layer.weight, "weight"), self.constant(layer.bias, "bias")
        result = self.add(
            "Conv", value, *names, strides=[layer.stride] * 2, pads=[layer.padding] * 4
        )
        return self._activation(result, layer.activation)

    def _channels_first(self, value: str, shape: tuple[int, ...]) -> str:
        """Return ``[n, channels * frames, height, width]``, all frames of a channel in a row."""
        *frames, height, width, channels = shape
        num_frames = int(np.prod(frames, dtype=np.int64))
        value = self.reshape(value, (num_frames, height, width, channels))
        value = self.add("Transpose", value, perm=[0, 4, 1, 2, 3])
        return self.reshape(value, (channels * num_frames, height, width))

    def _activation(self, value: str, activation: Activation) -> str:
        if activation == "none":
            return value
        if activation == "silu":
            return self.add("Mul", value, self.add("Sigmoid", value))
        return self.add(OPERATORS[activation], value)
