"""Does an exported policy compute what the trained one does? Ask every runtime.

PyTorch runs the trained network; NumPy and the game engine (GDScript in a real headless Godot, or
Rust in the Bevy game) run the ``.ludus.json``, ONNX Runtime the ``.onnx``. All get the same
observations.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from ludus.engine import InstalledEngine
from ludus.errors import ParityError
from ludus.export.compare import TOLERANCE, Comparison, compare
from ludus.export.engines import BevyGame, answer_with_engine
from ludus.export.inputs import ParityInputs, draw_inputs
from ludus.export.runtimes import (
    Answers,
    answer_with_numpy,
    answer_with_onnx,
    answer_with_torch,
)
from ludus.model.policy_model import PolicyModel
from ludus.networks.policy import Policy

__all__ = ["ParityReport", "PolicyFiles", "has_onnx_runtime", "measure_parity", "require_parity"]

Reference = Callable[[ParityInputs], Answers]
"""Answers of a network that is not Ludus's own."""


@dataclass(frozen=True)
class PolicyFiles:
    """One policy in all formats that are tested.

    Attributes:
        json: The ``.ludus.json``; None if that cannot hold it, which leaves NumPy and engines out.
        onnx: The ``.onnx``; None leaves ONNX Runtime out.
    """

    json: Path | None
    onnx: Path | None = None


@dataclass(frozen=True)
class ParityReport:
    """How far every runtime is from PyTorch.

    Attributes:
        policy: Name of the policy.
        num_random: Random observations.
        num_recorded: Observations from the training.
        comparisons: One per runtime.
    """

    policy: str
    num_random: int
    num_recorded: int
    comparisons: tuple[Comparison, ...]


def has_onnx_runtime() -> bool:
    """Return whether ONNX files can be written and run here."""
    return all(importlib.util.find_spec(name) for name in ("onnx", "onnxruntime"))


def measure_parity(
    policy: Policy | Reference,
    model: PolicyModel,
    files: PolicyFiles,
    engine: InstalledEngine | BevyGame | None,
    recorded: Mapping[str, NDArray[Any]],
) -> ParityReport:
    """Ask every runtime and compare its answers with those of PyTorch.

    Args:
        policy: The trained network, or what answers as it does.
        model: What was exported, or its outline.
        files: Where.
        engine: Godot or a Bevy game; None leaves the engine out.
        recorded: Observations from the training, per entry ``dtype[n, *shape]``; may be empty.

    Raises:
        EngineError: The engine failed.
    """
    inputs = draw_inputs(model, recorded)
    is_ours = isinstance(policy, Policy)
    expected = answer_with_torch(policy, inputs) if is_ours else policy(inputs)
    answers: dict[str, Answers] = {}
    if files.json is not None:
        answers["NumPy"] = answer_with_numpy(files.json, inputs)
    if files.onnx is not None:
        answers["ONNX Runtime"] = answer_with_onnx(files.onnx, inputs)
    if engine is not None and files.json is not None:
        is_bevy = isinstance(engine, BevyGame)
        name = "Bevy" if is_bevy else f"Godot {'.'.join(map(str, engine.version))}"
        answers[name] = answer_with_engine(engine, files.json, model, inputs)
    num_recorded = inputs.num_recorded * inputs.num_steps
    return ParityReport(
        policy=model.policy,
        num_random=inputs.num_agents * inputs.num_steps - num_recorded,
        num_recorded=num_recorded,
        comparisons=tuple(
            compare(name, expected, came, model, inputs) for name, came in answers.items()
        ),
    )


def require_parity(report: ParityReport) -> None:
    """Refuse a policy that computes something else than was trained.

    Raises:
        ParityError: A difference is above the tolerance.
    """
    for comparison in report.comparisons:
        if not comparison.is_equal:
            raise ParityError(
                f"policy {report.policy}: {comparison.runtime} differs from PyTorch by "
                f"{comparison.largest:.2g}, allowed is {TOLERANCE:g}: {comparison.worst}",
                "nothing was written; this is a defect, or the network computes with numbers so "
                "large that float32 loses them; --no-parity exports without the test",
            )
