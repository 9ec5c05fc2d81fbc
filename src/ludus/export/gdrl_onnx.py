"""Policies that Godot RL Agents saved as ``.onnx``, as policy files for its games on our classes.

Its games hand such a network the entry ``obs``, and read its output in the order in which the game
declares its actions: the logits of a choice, of which the largest counts, or the means of numbers,
cut off at -1 and 1. RLlib's networks put the deviations of numbers behind their means; those are
not used.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ludus.errors import PolicyFileError
from ludus.export.config import ExportConfig
from ludus.export.exporting import Exported
from ludus.export.foreign import find_policy, require_json, write_tested
from ludus.export.inputs import ParityInputs
from ludus.export.runtimes import Answers, most_probable
from ludus.model.policy_model import Activation, Distribution, Linear, PolicyModel
from ludus.spec import DiscreteAction, PolicySpec

__all__ = ["export_onnx"]

INPUT, OUTPUT = "obs", "output"
MAX_BYTES = 1 << 28
_ACTIVATIONS: dict[str, Activation] = {"Tanh": "tanh", "Relu": "relu", "Elu": "elu"}
_PASSING = {"Flatten", "Identity", "Cast", "Concat", "Reshape"}
"""Operators that leave a row of numbers as it is; a ``Concat`` does with one input."""
HINT = (
    "linear layers with tanh, relu or elu between them can be exported, as PPO of Godot RL Agents "
    "has them; for others train the game again, with `ludus train gdrl:PATH`"
)
NO_DEVIATION = -20.0
"""Logarithm of the deviation of numbers: drawn actions are the means, as the file has no other."""


def export_onnx(config: ExportConfig) -> Exported:
    """Write the network that ``config.run`` names, for a policy of ``config.game``.

    Raises:
        ConfigError: No game was named, or it has no such policy.
        PolicyFileError: The file cannot be read, is not a plain network, or does not fit the game.
        EngineNotFound, ParityError: As :func:`ludus.export.foreign.write_tested`.
        ModuleNotFoundError: ``onnx`` or ``onnxruntime`` is not installed.
    """
    layers = _read_layers(config.run)
    spec, path = find_policy(config, "gdrl:path/to/project")
    require_json(path, "policies of Godot RL Agents")
    order = _order(spec, len(layers[-1].bias))
    size = spec.observation[0].size
    if [entry.name for entry in spec.observation] != [INPUT] or layers[0].weight.shape[1] != size:
        seen = ", ".join(f"{entry.name} ({entry.size})" for entry in spec.observation)
        raise PolicyFileError(
            f"{config.run}: the network sees {layers[0].weight.shape[1]} numbers as {INPUT!r}, "
            f"agents of policy {spec.name} see {seen}"
        )
    last = layers[-1]
    layers[-1] = Linear(last.weight[order], last.bias[order], last.activation)
    model = PolicyModel(
        policy=spec.name,
        fingerprint=spec.fingerprint(),
        observation=spec.observation,
        action=spec.action,
        has_action_mask=False,
        normalisation=None,
        images=(),
        memory=None,
        layers=tuple(layers),
        distribution=Distribution(np.full(spec.continuous_size, NO_DEVIATION, np.float32)),
    )
    reference = _Reference(config.run, spec, order)
    return write_tested(model, path, reference, is_tested=config.is_tested, godot=config.godot)


def _read_layers(path: Path) -> list[Linear]:
    """Return the layers between ``obs`` and ``output``, in order.

    Raises:
        PolicyFileError: The file cannot be read, or has other parts.
    """
    import onnx
    from google.protobuf.message import DecodeError
    from onnx import numpy_helper

    try:
        if path.stat().st_size > MAX_BYTES:
            raise PolicyFileError(f"{path}: more than {MAX_BYTES} bytes")
        # What a graph names outside of its file is not opened.
        graph = cast(Any, onnx).load(str(path), load_external_data=False).graph
        arrays = {part.name: numpy_helper.to_array(part) for part in graph.initializer}
    except OSError as error:
        raise PolicyFileError(f"cannot read {path}: {error.strerror}") from error
    except (DecodeError, ValueError, TypeError) as error:
        raise PolicyFileError(f"{path}: not an ONNX file: {error}") from error
    layers: list[Linear] = []
    for node in _nodes_between(graph, path):
        if node.op_type == "Gemm":
            layers.append(_linear(node, arrays, path))
        elif node.op_type in _ACTIVATIONS and layers and layers[-1].activation == "none":
            activation = _ACTIVATIONS[node.op_type]
            layers[-1] = Linear(layers[-1].weight, layers[-1].bias, activation)
        elif node.op_type not in _PASSING or (node.op_type == "Concat" and len(node.input) > 1):
            raise PolicyFileError(
                f"{path}: a plain network has no {node.op_type}",
                HINT,
            )
    if not layers or layers[-1].activation != "none":
        raise PolicyFileError(f"{path}: it does not end in a linear layer")
    return layers


def _nodes_between(graph: Any, path: Path) -> Iterator[Any]:
    value = INPUT
    while value != OUTPUT:
        users = [node for node in graph.node if value in node.input]
        if len(users) != 1:
            raise PolicyFileError(
                f"{path}: {len(users)} parts take {value!r}; in a plain network that leads from "
                f"{INPUT!r} to {OUTPUT!r} it is one",
                HINT,
            )
        yield users[0]
        value = users[0].output[0]


def _linear(node: Any, arrays: dict[str, NDArray[Any]], path: Path) -> Linear:
    settings = {part.name: part.i or part.f for part in node.attribute}
    weight, bias = (arrays.get(name) for name in (*node.input[1:], "", "")[:2])
    is_plain = settings.get("alpha", 1.0) == settings.get("beta", 1.0) == 1.0
    if weight is None or bias is None or not is_plain or settings.get("transA"):
        raise PolicyFileError(f"{path}: {node.name or 'a Gemm'} is not a linear layer")
    rows = weight if settings.get("transB") else weight.T
    return Linear(np.ascontiguousarray(rows, np.float32), bias.astype(np.float32), "none")


def _order(spec: PolicySpec, num_outputs: int) -> list[int]:
    """Return the places of our outputs among those of the network: all logits, then all means.

    Raises:
        PolicyFileError: The network has another number of outputs.
    """
    sizes = [part.n if isinstance(part, DiscreteAction) else part.size for part in spec.action]
    has_deviations = num_outputs == sum(sizes) + spec.continuous_size != sum(sizes)
    logits: list[int] = []
    means: list[int] = []
    next_place = 0
    for part, size in zip(spec.action, sizes, strict=True):
        is_choice = isinstance(part, DiscreteAction)
        (logits if is_choice else means).extend(range(next_place, next_place + size))
        next_place += size if is_choice or not has_deviations else 2 * size
    if next_place != num_outputs:
        raise PolicyFileError(
            f"the network has {num_outputs} outputs, the actions of policy {spec.name} take "
            f"{next_place}",
            hint="a network for choices has one output for each alternative, as those of Godot RL "
            "Agents since 0.7 have",
        )
    return logits + means


class _Reference:
    """Answers as the game would with ONNX Runtime."""

    def __init__(self, path: Path, spec: PolicySpec, order: list[int]) -> None:
        import onnxruntime

        runtime = cast(Any, onnxruntime)
        self._session = runtime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
        self._spec, self._order = spec, order

    def __call__(self, inputs: ParityInputs) -> Answers:
        return Answers.of_steps(
            [self._step(inputs.at(i)[0][INPUT]) for i in range(inputs.num_steps)]
        )

    def _step(self, seen: NDArray[Any]) -> tuple[NDArray[Any], ...]:
        states = np.zeros(len(seen), np.float32)
        names = [value.name for value in self._session.get_inputs()]
        feed = {name: seen.astype(np.float32) if name == INPUT else states for name in names}
        outputs = self._session.run([OUTPUT], feed)[0][:, self._order]
        discrete = most_probable(outputs, self._spec.nvec, None)
        means = outputs[:, outputs.shape[1] - self._spec.continuous_size :]
        low, high = self._spec.continuous_bounds()
        log_std = np.full_like(means, NO_DEVIATION)
        return outputs, log_std, discrete, np.clip(means, low, high)
