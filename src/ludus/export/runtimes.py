"""Answers of PyTorch, NumPy and ONNX Runtime to the inputs of a parity test."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from numpy.typing import NDArray

from ludus.export.inputs import ParityInputs
from ludus.model.inference import ModelRunner
from ludus.model.json_file import read_model
from ludus.networks.policy import Policy
from ludus.networks.tensors import as_tensor, as_tensors

__all__ = ["Answers", "answer_with_numpy", "answer_with_onnx", "answer_with_torch", "most_probable"]


@dataclass(frozen=True)
class Answers:
    """The answers of a runtime to :class:`~ludus.export.inputs.ParityInputs`.

    Attributes:
        outputs: ``float32[steps, n, num_outputs]``, raw.
        log_std: ``float32[steps, n, continuous_size]``.
        discrete: ``int64[steps, n, num_discrete]``, most probable choices.
        continuous: ``float32[steps, n, continuous_size]``, means in the bounds of the action space.
    """

    outputs: NDArray[np.float32]
    log_std: NDArray[np.float32]
    discrete: NDArray[np.int64]
    continuous: NDArray[np.float32]

    @classmethod
    def of_steps(cls, steps: Sequence[tuple[NDArray[Any], ...]]) -> Answers:
        """Join the answers to single steps."""
        return cls(*(np.stack(parts) for parts in zip(*steps, strict=True)))


@torch.inference_mode()
def answer_with_torch(policy: Policy, inputs: ParityInputs) -> Answers:
    """Ask the trained network itself."""
    size, head = policy.memory_size, policy.head
    state = torch.zeros(inputs.num_agents, size, device=policy.device) if size else None
    steps: list[tuple[NDArray[Any], ...]] = []
    for step in range(inputs.num_steps):
        observation, mask = inputs.at(step)
        encoded = policy.encoder(as_tensors(observation, policy.device))
        outputs, state = policy.act_on(encoded, state)
        allowed = None if mask is None else as_tensor(mask, policy.device)
        discrete, continuous = head.sample(outputs, None, allowed)
        mean, log_std = head.gaussian(outputs)
        tensors = (outputs, log_std.expand_as(mean), discrete, head.to_bounds(continuous))
        steps.append(tuple(tensor.cpu().numpy().copy() for tensor in tensors))
    return Answers.of_steps(steps)


def answer_with_numpy(path: Path, inputs: ParityInputs) -> Answers:
    """Ask :class:`~ludus.model.inference.ModelRunner`.

    Args:
        path: A ``.ludus.json`` file.
        inputs: What to ask.
    """
    model = read_model(path)
    runner, distribution = ModelRunner(model), model.distribution
    memory: NDArray[np.float32] | None = None
    steps: list[tuple[NDArray[Any], ...]] = []
    for step in range(inputs.num_steps):
        observation, mask = inputs.at(step)
        outputs, _ = runner.outputs(observation, memory)
        actions, memory = runner.act(observation, mask, memory)
        log_std = distribution.log_std
        if log_std is None:
            own = outputs[:, model.num_outputs - model.spec.continuous_size :]
            log_std = np.clip(own, *distribution.log_std_range)
        log_std = np.broadcast_to(log_std, actions.continuous.shape)
        steps.append((outputs, log_std, actions.discrete, actions.continuous))
    return Answers.of_steps(steps)


def answer_with_onnx(path: Path, inputs: ParityInputs) -> Answers:
    """Ask ONNX Runtime, on the CPU.

    Args:
        path: An ``.onnx`` file.
        inputs: What to ask.
    """
    import onnxruntime

    from ludus.export.onnx_file import MASK, MEMORY

    runtime = cast(Any, onnxruntime)
    session = runtime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    sizes = {value.name: value.shape for value in session.get_inputs()}
    names = [value.name for value in session.get_outputs()]
    memory = None
    if MEMORY in sizes:
        memory = np.zeros((inputs.num_agents, sizes[MEMORY][1]), np.float32)
    steps: list[tuple[NDArray[Any], ...]] = []
    for step in range(inputs.num_steps):
        observation, mask = inputs.at(step)
        feed = {**observation, MASK: mask, MEMORY: memory}
        values = session.run(None, {name: feed[name] for name in sizes})
        answer = dict(zip(names, values, strict=True))
        memory = answer.get("memory_out")
        none = np.zeros((inputs.num_agents, 0))
        steps.append((
            answer["outputs"],
            answer.get("log_std", none.astype(np.float32)),
            answer.get("discrete", none.astype(np.int64)),
            answer.get("continuous", none.astype(np.float32)),
        ))  # fmt: skip
    return Answers.of_steps(steps)


def most_probable(
    outputs: NDArray[np.float32], nvec: Sequence[int], mask: NDArray[np.bool_] | None
) -> NDArray[np.int64]:
    """Return the choice of every discrete component with the largest logit that is allowed.

    Args:
        outputs: Logits of all components first, in order.
        nvec: Alternatives of each component.
        mask: ``bool[n, logits]``; None allows all.
    """
    chosen = np.zeros((len(outputs), len(nvec)), np.int64)
    start = 0
    for i, n in enumerate(nvec):
        logits = outputs[:, start : start + n]
        if mask is not None:
            logits = np.where(mask[:, start : start + n], logits, -1e8)
        chosen[:, i] = logits.argmax(1)
        start += n
    return chosen
