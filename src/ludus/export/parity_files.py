"""The files of a parity test in a game engine: what it is asked, and what it answers."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ludus.errors import EngineError
from ludus.export.inputs import ParityInputs
from ludus.export.runtimes import Answers
from ludus.model.policy_model import PolicyModel

__all__ = ["ANSWERS", "REQUEST", "read_answers", "write_request"]

REQUEST, INPUTS, ANSWERS = "request.json", "inputs.bin", "answers.bin"


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


def read_answers(folder: Path, model: PolicyModel, inputs: ParityInputs) -> Answers:
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
