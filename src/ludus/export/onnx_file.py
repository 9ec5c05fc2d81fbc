"""Policies as ONNX files, for ONNX Runtime and all that reads the format.

Inputs, ``n`` agents at once: every observation entry by its name and in its own dtype, images as
they are; of a policy that sees several frames, all of them, the oldest first
(``[n, frames, …]``); ``action_mask`` (bool) if the policy has masks; ``memory`` (zeros at the
beginning of an episode) if it has one. Outputs:

- ``outputs``: the raw outputs of the network, ``float32[n, outputs]``;
- ``discrete``: the most probable choices, ``int64[n, components]``;
- ``continuous``: the means, in the bounds of the action space, ``float32[n, size]``;
- ``log_std``: log deviations where the bounds are -1 and 1, before squashing or cutting off;
- ``memory_out``: what ``memory`` is in the next step.

``discrete``, ``continuous`` with ``log_std``, and ``memory_out`` are there if the policy has such
a part. The metadata hold the policy's name, the fingerprint of its spec, and the spec as JSON.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import onnx
from onnx import TensorProto, ValueInfoProto, helper

from ludus.disk import disk_errors, write_atomically
from ludus.errors import RunError
from ludus.export.onnx_graph import OnnxGraph
from ludus.model.inference import FORBIDDEN
from ludus.model.policy_model import PolicyModel, is_image
from ludus.spec import ObservationEntry
from ludus.version import __version__

__all__ = ["MASK", "MEMORY", "OPSET", "check_names", "to_onnx", "with_metadata", "write_onnx"]

OPSET, IR_VERSION = 17, 8
"""From 2022, so that runtimes of the last years can read the files."""
MASK, MEMORY = "action_mask", "memory"
RESERVED = (MASK, MEMORY, "memory_out", "outputs", "discrete", "continuous", "log_std")
"""Names of other inputs and outputs, which no observation entry may have."""

ELEMENT_TYPES = {
    "float32": TensorProto.FLOAT,
    "uint8": TensorProto.UINT8,
    "int64": TensorProto.INT64,
}


def write_onnx(path: Path, model: PolicyModel) -> None:
    """Write a policy as an ONNX file, whole or not at all.

    Raises:
        RunError: The disk is full, the folder may not be written to, or an observation entry has
            the name of another input or output.
    """
    data = to_onnx(model).SerializeToString()
    with disk_errors(str(path)):
        write_atomically(path, data)


def to_onnx(model: PolicyModel) -> onnx.ModelProto:
    """Return a policy as an ONNX model that has passed ONNX's checker.

    Raises:
        RunError: An observation entry has the name of another input or output.
    """
    check_names(model)
    graph = OnnxGraph()
    features = _features(graph, model)
    outputs: list[ValueInfoProto] = []
    if model.memory is not None:
        features = graph.gru(features, MEMORY, model.memory)
        graph.name_output(features, "memory_out")
        outputs.append(_float_info("memory_out", model.memory.size))
    for layer in model.layers:
        features = graph.linear(features, layer)
    graph.name_output(features, "outputs")
    outputs.append(_float_info("outputs", model.layers[-1].weight.shape[0]))
    outputs += _discrete(graph, model)
    outputs += _continuous(graph, model)
    return _checked(graph, model, outputs)


def check_names(model: PolicyModel) -> None:
    """Refuse an observation entry that has the name of another input or output.

    Raises:
        RunError: It names the entry.
    """
    for entry in model.observation:
        if entry.name in RESERVED:
            raise RunError(
                f"policy {model.policy}: the observation entry {entry.name} has the name of "
                "another input or output of the ONNX file",
                "rename the entry and train again, or export to .ludus.json",
            )


def _features(graph: OnnxGraph, model: PolicyModel) -> str:
    """Return the joined vector, normalised, and the features of the images behind it."""
    vectors = [entry for entry in model.inputs if not is_image(entry)]
    parts = [_vector(graph, model, vectors)] if vectors else []
    shapes = {entry.name: entry.shape for entry in model.inputs}
    for image in model.images:
        parts.append(graph.image_network(image.entry, shapes[image.entry], image))
    return graph.joined(parts)


def _vector(graph: OnnxGraph, model: PolicyModel, entries: Sequence[ObservationEntry]) -> str:
    parts: list[str] = []
    for entry in entries:
        flat = graph.add("Flatten", entry.name, axis=1)
        parts.append(graph.add("Cast", flat, to=TensorProto.FLOAT))
    vector, normalisation = graph.joined(parts), model.normalisation
    if normalisation is None:
        return vector
    vector = graph.add("Sub", vector, graph.constant(normalisation.shift, "shift"))
    vector = graph.add("Mul", vector, graph.constant(normalisation.scale, "scale"))
    return graph.clip(vector, -normalisation.limit, normalisation.limit)


def _discrete(graph: OnnxGraph, model: PolicyModel) -> list[ValueInfoProto]:
    """Choose the largest allowed logit of each component."""
    nvec = model.spec.nvec
    if not nvec:
        return []
    logits = graph.columns("outputs", 0, sum(nvec))
    if model.has_action_mask:
        logits = graph.add("Where", MASK, logits, graph.number(float(FORBIDDEN)))
    chosen: list[str] = []
    start = 0
    for n in nvec:
        component = graph.columns(logits, start, start + n)
        chosen.append(graph.add("ArgMax", component, axis=1, keepdims=1))
        start += n
    graph.name_output(graph.joined(chosen), "discrete")
    return [helper.make_tensor_value_info("discrete", TensorProto.INT64, ["n", len(nvec)])]


def _continuous(graph: OnnxGraph, model: PolicyModel) -> list[ValueInfoProto]:
    """Bring the means into the bounds of the action space."""
    start, size = sum(model.spec.nvec), model.spec.continuous_size
    if not size:
        return []
    mean = graph.columns("outputs", start, start + size)
    is_squashed = model.distribution.is_squashed
    unit = graph.add("Tanh", mean) if is_squashed else graph.clip(mean, -1.0, 1.0)
    low, high = model.spec.continuous_bounds()
    share = graph.add("Mul", graph.add("Add", unit, graph.number(1.0)), graph.number(0.5))
    stretched = graph.add("Mul", share, graph.constant(high - low, "width"))
    graph.name_output(graph.add("Add", stretched, graph.constant(low, "low")), "continuous")
    graph.name_output(_log_std(graph, model, mean), "log_std")
    return [_float_info("continuous", size), _float_info("log_std", size)]


def _log_std(graph: OnnxGraph, model: PolicyModel, mean: str) -> str:
    distribution = model.distribution
    if distribution.log_std is None:
        own = graph.columns("outputs", model.num_outputs - model.spec.continuous_size,
                            model.num_outputs)  # fmt: skip
        return graph.clip(own, *distribution.log_std_range)
    shape = graph.add("Shape", mean)
    return graph.add("Expand", graph.constant(distribution.log_std, "log_std"), shape)


def _inputs(model: PolicyModel) -> list[ValueInfoProto]:
    inputs = [
        helper.make_tensor_value_info(entry.name, ELEMENT_TYPES[entry.dtype], ["n", *entry.shape])
        for entry in model.inputs
    ]
    if model.has_action_mask:
        size = sum(model.spec.nvec)
        inputs.append(helper.make_tensor_value_info(MASK, TensorProto.BOOL, ["n", size]))
    if model.memory is not None:
        inputs.append(_float_info(MEMORY, model.memory.size))
    return inputs


def _float_info(name: str, size: int) -> ValueInfoProto:
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, ["n", size])


def _checked(
    graph: OnnxGraph, model: PolicyModel, outputs: Sequence[ValueInfoProto]
) -> onnx.ModelProto:
    body = helper.make_graph(graph.nodes, "ludus_policy", _inputs(model), outputs, graph.constants)
    proto = helper.make_model(
        body,
        opset_imports=[helper.make_opsetid("", OPSET)],
        ir_version=IR_VERSION,
        producer_name="ludus",
        producer_version=__version__,
    )
    return with_metadata(proto, model)


def with_metadata(proto: onnx.ModelProto, model: PolicyModel) -> onnx.ModelProto:
    """Add the policy's name and spec to an ONNX model, and check it."""
    spec = {
        "observation": [entry.to_json() for entry in model.observation],
        "action": [part.to_json() for part in model.action],
        "has_action_mask": model.has_action_mask,
        "frames": model.frames,
    }
    metadata = {"policy": model.policy, "fingerprint": model.fingerprint, "spec": json.dumps(spec)}
    helper.set_model_props(proto, metadata)
    cast(Any, onnx.checker).check_model(proto, full_check=True)
    return proto
