"""Answers of the add-on's GDScript inference, in a real headless Godot."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ludus.engine import (
    EngineKind,
    EngineProcess,
    InstalledEngine,
    LaunchConfig,
    ensure_imported,
    find_engine,
    find_project,
)
from ludus.engine.bundled import runnable_bundled_root
from ludus.errors import EngineError, EngineNotFound, EngineTimeout
from ludus.model.policy_model import PolicyModel
from ludus.train.export.inputs import ParityInputs
from ludus.train.export.runtimes import Answers

__all__ = ["answer_with_godot", "find_godot"]

SCRIPT = Path(__file__).with_name("parity.gd")
SCRIPT3 = Path(__file__).with_name("parity3.gd")
"""The same for Godot 3."""
REQUEST, INPUTS, ANSWERS = "request.json", "inputs.bin", "answers.bin"
TIMEOUT_S = 120.0
"""How long Godot may take for all answers."""


def find_godot(godot: Path | None = None, kind: EngineKind = EngineKind.GODOT4) -> InstalledEngine:
    """Return the engine to test with.

    Args:
        godot: The engine the user insists on; None finds one.
        kind: Which Godot the policy was trained in.

    Raises:
        EngineNotFound: There is none; the hint says how to get one, or to do without.
        ConfigError: The engine that the user named cannot be used.
    """
    try:
        return find_engine(kind, godot)
    except EngineNotFound as error:
        raise EngineNotFound(
            f"the exported policy cannot be tested in Godot: {error.message}",
            f"{error.hint}; or export without the test: --no-parity",
        ) from None


def answer_with_godot(
    engine: InstalledEngine, path: Path, model: PolicyModel, inputs: ParityInputs
) -> Answers:
    """Ask ``LudusPolicy`` in the bundled project.

    Args:
        engine: The engine to run.
        path: A ``.ludus.json`` file.
        model: What is in it.
        inputs: What to ask.

    Raises:
        EngineError: Godot failed, did not end in time, or gave another number of answers.
    """
    project = find_project(runnable_bundled_root(engine.kind))
    ensure_imported(engine, project)
    with tempfile.TemporaryDirectory(prefix="ludus-parity-") as name:
        folder = Path(name)
        _write_request(folder, path, model, inputs)
        _run(engine, project.root, folder)
        return _read_answers(folder / ANSWERS, model, inputs)


def _write_request(folder: Path, path: Path, model: PolicyModel, inputs: ParityInputs) -> None:
    request = {
        "policy": str(path.resolve()),
        "num_steps": inputs.num_steps,
        "num_agents": inputs.num_agents,
        "entries": [
            {"name": entry.name, "dtype": entry.dtype, "size": entry.size}
            for entry in model.observation
        ],
        "mask_size": model.spec.mask_size,
    }
    (folder / REQUEST).write_text(json.dumps(request), encoding="utf-8")
    with (folder / INPUTS).open("wb") as file:
        for step in range(inputs.num_steps):
            observation, mask = inputs.at(step)
            for entry in model.observation:
                file.write(observation[entry.name].astype(entry.numpy_dtype).tobytes())
            if mask is not None:
                file.write(mask.astype(np.uint8).tobytes())


def _run(engine: InstalledEngine, project: Path, folder: Path) -> None:
    is_godot3 = engine.kind is EngineKind.GODOT3
    program = str(engine.executable(headless=True))
    display = "--no-window" if is_godot3 else "--headless"
    script = str(SCRIPT3 if is_godot3 else SCRIPT)
    command = (program, display, "--path", str(project), "-s", script, "--", str(folder))
    with EngineProcess.start(LaunchConfig(command=command)) as process:
        code = process.wait(TIMEOUT_S)
        report = process.describe_death()
    if code is None:
        raise EngineTimeout(
            f"Godot did not test the policy within {TIMEOUT_S:.0f} s\n{report}",
            "a large network takes long in GDScript; --no-parity exports without the test",
        )
    if code != 0 or not (folder / ANSWERS).is_file():
        raise EngineError(
            f"the exported policy does not run in Godot: {report}",
            "this is a defect; --no-parity exports without the test",
        )


def _read_answers(path: Path, model: PolicyModel, inputs: ParityInputs) -> Answers:
    spec, rows = model.spec, inputs.num_agents
    parts: list[tuple[str, int]] = [
        ("<f4", model.num_outputs),
        ("<f4", spec.continuous_size),
        ("<i8", spec.num_discrete),
        ("<f4", spec.continuous_size),
    ]
    row = np.dtype([(f"part_{i}", dtype, (rows, size)) for i, (dtype, size) in enumerate(parts)])
    data = path.read_bytes()
    if len(data) != row.itemsize * inputs.num_steps:
        raise EngineError(
            f"Godot gave {len(data)} bytes of answers, expected {row.itemsize * inputs.num_steps}",
            "the add-on may be of another version than ludus: install ludus again",
        )
    steps: NDArray[Any] = np.frombuffer(data, row)
    return Answers(*(steps[f"part_{i}"] for i in range(len(parts))))
