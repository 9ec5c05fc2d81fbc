"""Answers of the add-on's GDScript inference, in a real headless Godot."""

from __future__ import annotations

import tempfile
from pathlib import Path

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
from ludus.export.inputs import ParityInputs
from ludus.export.parity_files import ANSWERS, read_answers, write_request
from ludus.export.runtimes import Answers
from ludus.model.policy_model import PolicyModel

__all__ = ["answer_with_godot", "find_godot"]

SCRIPT = Path(__file__).with_name("parity.gd")
SCRIPT3 = Path(__file__).with_name("parity3.gd")
"""The same for Godot 3."""
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
        write_request(folder, path, model, inputs)
        _run(engine, project.root, folder)
        return read_answers(folder, model, inputs)


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
