"""Answers of game engines: GDScript in a real headless Godot, Rust in a game made with Bevy.

Both read the question from files in a folder and write their answers there.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
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
    find_project,
)
from ludus.engine.bundled import runnable_bundled_root
from ludus.errors import EngineError, EngineTimeout
from ludus.export.inputs import ParityInputs
from ludus.export.runtimes import Answers
from ludus.locks import TemporaryFolder
from ludus.model.policy_model import PolicyModel

__all__ = ["BevyGame", "answer_with_engine"]

SCRIPT = Path(__file__).with_name("parity.gd")
SCRIPT3 = Path(__file__).with_name("parity3.gd")
"""The same for Godot 3."""
REQUEST, INPUTS, ANSWERS = "request.json", "inputs.bin", "answers.bin"
TIMEOUT_S = 120.0
"""How long an engine may take for all answers."""


@dataclass(frozen=True)
class BevyGame:
    """A game made with ``bevy_ludus``, which answers ``--ludus-parity`` without being played.

    Attributes:
        program: Its executable.
    """

    program: Path


def answer_with_engine(
    engine: InstalledEngine | BevyGame, path: Path, model: PolicyModel, inputs: ParityInputs
) -> Answers:
    """Ask ``LudusPolicy`` in the bundled Godot project, or a Bevy game.

    Args:
        engine: What to run.
        path: A ``.ludus.json`` file.
        model: What is in it.
        inputs: What to ask.

    Raises:
        EngineError: The engine failed, did not end in time, or gave another number of answers.
    """
    with TemporaryFolder("parity") as temporary:
        folder = temporary.path
        write_request(folder, path, model, inputs)
        if isinstance(engine, BevyGame):
            _run(
                "Bevy",
                (str(engine.program), f"--ludus-parity={folder}"),
                folder,
                slow="it may have been built before bevy_ludus knew --ludus-parity: build it again",
                broken="build the game again with the bevy_ludus of this version",
            )
        else:
            _run(
                "Godot",
                _godot_command(engine, folder),
                folder,
                slow="a large network takes long in GDScript",
                broken="this is a defect",
            )
        return _read_answers(folder, model, inputs)


def _godot_command(engine: InstalledEngine, folder: Path) -> tuple[str, ...]:
    project = find_project(runnable_bundled_root(engine.kind))
    ensure_imported(engine, project)
    program = str(engine.executable(headless=True))
    is_godot3 = engine.kind is EngineKind.GODOT3
    display, script = ("--no-window", SCRIPT3) if is_godot3 else ("--headless", SCRIPT)
    return (program, display, "--path", str(project.root), "-s", str(script), "--", str(folder))


def _run(name: str, command: tuple[str, ...], folder: Path, *, slow: str, broken: str) -> None:
    """Run an engine to its end; ``slow`` and ``broken`` are hints for when it fails."""
    way_out = "; --no-parity exports without the test"
    with EngineProcess.start(LaunchConfig(command=command)) as process:
        code = process.wait(TIMEOUT_S)
        report = process.describe_death()
    if code is None:
        raise EngineTimeout(
            f"{name} did not test the policy within {TIMEOUT_S:g} s\n{report}", slow + way_out
        )
    if code != 0 or not (folder / ANSWERS).is_file():
        raise EngineError(f"the exported policy does not run in {name}: {report}", broken + way_out)


def write_request(folder: Path, path: Path, model: PolicyModel, inputs: ParityInputs) -> None:
    """Write what an engine is asked.

    Args:
        folder: Where to.
        path: A ``.ludus.json`` file.
        model: What is in it.
        inputs: What to ask.
    """
    request = {
        "policy": str(path.resolve()),
        "num_steps": inputs.num_steps,
        "num_agents": inputs.num_agents,
        "entries": [
            {"name": entry.name, "dtype": entry.dtype, "size": entry.size} for entry in model.inputs
        ],
        "mask_size": model.spec.mask_size,
    }
    (folder / REQUEST).write_text(json.dumps(request), encoding="utf-8")
    with (folder / INPUTS).open("wb") as file:
        for step in range(inputs.num_steps):
            observation, mask = inputs.at(step)
            for entry in model.inputs:
                file.write(observation[entry.name].astype(entry.numpy_dtype).tobytes())
            if mask is not None:
                file.write(mask.astype(np.uint8).tobytes())


def _read_answers(folder: Path, model: PolicyModel, inputs: ParityInputs) -> Answers:
    """Read what an engine has answered.

    Raises:
        EngineError: There are too few or too many bytes.
    """
    spec, rows = model.spec, inputs.num_agents
    parts: list[tuple[str, int]] = [
        ("<f4", model.num_outputs),
        ("<f4", spec.continuous_size),
        ("<i8", spec.num_discrete),
        ("<f4", spec.continuous_size),
    ]
    row = np.dtype([(f"part_{i}", dtype, (rows, size)) for i, (dtype, size) in enumerate(parts)])
    data = (folder / ANSWERS).read_bytes()
    expected = row.itemsize * inputs.num_steps
    if len(data) != expected:
        raise EngineError(
            f"the engine gave {len(data)} bytes of answers, expected {expected}",
            "its add-on may be of another version than ludus: install ludus again",
        )
    steps: NDArray[Any] = np.frombuffer(data, row)
    return Answers(*(steps[f"part_{i}"] for i in range(len(parts))))
