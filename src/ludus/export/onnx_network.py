"""A network that a script made as an ONNX file, by PyTorch's exporter.

Inputs, outputs and metadata are those of :mod:`ludus.export.onnx_file`.
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any, cast

import onnx
import torch
from torch import Tensor, nn
from torch.nn import functional

from ludus.disk import disk_errors, write_atomically
from ludus.errors import RunError
from ludus.export.onnx_file import MASK, MEMORY, OPSET, check_names, with_metadata
from ludus.locks import TemporaryFolder
from ludus.model.policy_model import PolicyModel
from ludus.networks.distributions import FORBIDDEN
from ludus.networks.policy import Policy

__all__ = ["write_network"]

ROWS = 2
"""Of the example that is traced."""


def write_network(path: Path, policy: Policy, outline: PolicyModel) -> None:
    """Write a policy as an ONNX file, whole or not at all.

    Args:
        path: Where to.
        policy: The trained network.
        outline: What surrounds it, see :func:`ludus.export.convert.outline`.

    Raises:
        RunError: PyTorch cannot export the network, or the file cannot be written.
    """
    check_names(outline)
    graph = _Graph(policy, outline).cpu().eval()
    example = graph.example()
    names, outputs = list(example), graph.output_names()
    with TemporaryFolder("onnx") as temporary:
        traced = temporary.path / "network.onnx"
        try:
            with warnings.catch_warnings(), torch.no_grad():
                # The exporter that traces; the newer one needs onnxscript, and says so each time.
                warnings.simplefilter("ignore")
                cast(Any, torch.onnx).export(
                    graph,
                    tuple(example.values()),
                    str(traced),
                    dynamo=False,
                    input_names=names,
                    output_names=outputs,
                    dynamic_axes={name: {0: "n"} for name in [*names, *outputs]},
                    opset_version=OPSET,
                )
        except Exception as error:  # whatever operators a network may use
            raise RunError(
                f"policy {outline.policy}: PyTorch cannot export its network to ONNX: {error}",
                "build it from the layers that torch.onnx supports",
            ) from error
        proto = cast(Any, onnx).load(str(traced))
    data = with_metadata(proto, outline).SerializeToString()
    with disk_errors(str(path)):
        write_atomically(path, data)


class _Graph(nn.Module):
    """A policy from observations to actions, as one function of tensors in a fixed order."""

    def __init__(self, policy: Policy, outline: PolicyModel) -> None:
        super().__init__()
        self.policy = policy
        self._outline = outline

    def example(self) -> dict[str, Tensor]:
        """Return an input of each name, in order."""
        kinds = {"float32": torch.float32, "uint8": torch.uint8, "int64": torch.int64}
        inputs = {
            entry.name: torch.zeros(ROWS, *entry.shape, dtype=kinds[entry.dtype])
            for entry in self._outline.inputs
        }
        if self._outline.has_action_mask:
            inputs[MASK] = torch.ones(ROWS, self.policy.head.num_logits, dtype=torch.bool)
        if self.policy.memory_size:
            inputs[MEMORY] = torch.zeros(ROWS, self.policy.memory_size)
        return inputs

    def output_names(self) -> list[str]:
        """Return the names of what :meth:`forward` returns."""
        head = self.policy.head
        names = ["memory_out"] * bool(self.policy.memory_size) + ["outputs"]
        return names + ["discrete"] * bool(head.nvec) + ["continuous", "log_std"] * bool(head.size)

    def forward(self, *tensors: Tensor) -> tuple[Tensor, ...]:
        given = dict(zip(self.example(), tensors, strict=True))
        policy, head = self.policy, self.policy.head
        features = policy.features(policy.encoder(given))
        answers: list[Tensor] = []
        if policy.memory is not None:
            features = _advance(policy.memory, features, given[MEMORY])
            answers.append(features)
        outputs = policy.actor(features)
        answers.append(outputs)
        if head.nvec:
            logits = outputs[:, : head.num_logits]
            if MASK in given:
                logits = logits.masked_fill(~given[MASK], FORBIDDEN)
            parts = logits.split(head.nvec, 1)
            answers.append(torch.cat([part.argmax(1, keepdim=True) for part in parts], 1))
        if head.size:
            mean, log_std = head.gaussian(outputs)
            unit = mean.tanh() if head.shape.is_squashed else mean.clamp(-1.0, 1.0)
            answers.append(head.low + (head.high - head.low) * (unit + 1.0) * 0.5)
            answers.append(log_std + torch.zeros_like(mean))
        return tuple(answers)


def _advance(cell: nn.GRUCell, x: Tensor, state: Tensor) -> Tensor:
    """Return the next state of a GRU; the exporter does not know the cell itself."""
    of_input = functional.linear(x, cell.weight_ih, cell.bias_ih).chunk(3, 1)
    of_state = functional.linear(state, cell.weight_hh, cell.bias_hh).chunk(3, 1)
    reset = (of_input[0] + of_state[0]).sigmoid()
    update = (of_input[1] + of_state[1]).sigmoid()
    new = (of_input[2] + reset * of_state[2]).tanh()
    return new + update * (state - new)
