"""Answers of the inference of ``bevy_ludus``, in the very game that a policy was trained in."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

from ludus.engine import EngineProcess, LaunchConfig
from ludus.errors import EngineError, EngineTimeout
from ludus.export.inputs import ParityInputs
from ludus.export.parity_files import ANSWERS, read_answers, write_request
from ludus.export.runtimes import Answers
from ludus.model.policy_model import PolicyModel

__all__ = ["BevyGame", "answer_with_bevy"]

TIMEOUT_S = 120.0
"""How long the game may take for all answers."""


@dataclass(frozen=True)
class BevyGame:
    """A game made with ``bevy_ludus``.

    Attributes:
        program: Its executable.
    """

    program: Path


def answer_with_bevy(
    game: BevyGame, path: Path, model: PolicyModel, inputs: ParityInputs
) -> Answers:
    """Ask a game, which answers ``--ludus-parity`` without being played.

    Args:
        game: The game to ask.
        path: A ``.ludus.json`` file.
        model: What is in it.
        inputs: What to ask.

    Raises:
        EngineError: The game failed, did not end in time, or gave another number of answers.
    """
    with tempfile.TemporaryDirectory(prefix="ludus-parity-") as name:
        folder = Path(name)
        write_request(folder, path, model, inputs)
        _run(game.program, folder)
        return read_answers(folder, model, inputs)


def _run(program: Path, folder: Path) -> None:
    command = (str(program), f"--ludus-parity={folder}")
    with EngineProcess.start(LaunchConfig(command=command)) as process:
        code = process.wait(TIMEOUT_S)
        report = process.describe_death()
    if code is None:
        raise EngineTimeout(
            f"{program.name} did not test the policy within {TIMEOUT_S:g} s\n{report}",
            "it may have been built before bevy_ludus knew --ludus-parity: build it again; "
            "--no-parity exports without the test",
        )
    if code != 0 or not (folder / ANSWERS).is_file():
        raise EngineError(
            f"the exported policy does not run in Bevy: {report}",
            "build the game again with the bevy_ludus of this version; --no-parity exports "
            "without the test",
        )
