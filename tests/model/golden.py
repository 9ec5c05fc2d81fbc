"""The golden policies of ``protocol/golden/policies``: small models, inputs, expected outputs.

``python -m tests.model.golden`` writes them anew. Layout of the cases: ``protocol/POLICY.md`` §6.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ludus.model import ModelRunner, PolicyModel, write_model
from ludus.model.frame_stack import FrameStack
from tests.model.models import MODELS

FOLDER = Path(__file__).resolve().parents[2] / "protocol" / "golden" / "policies"
NUM_AGENTS = 5
BEGINS = [[0, 1, 2, 3, 4], [], [1, 4]]
"""Agents that begin an episode, for each step."""


def model_path(name: str) -> Path:
    return FOLDER / f"{name}.ludus.json"


def cases_path(name: str) -> Path:
    return FOLDER / f"{name}.cases.json"


def draw_observation(model: PolicyModel, rng: np.random.Generator) -> dict[str, NDArray[Any]]:
    """Return ``dtype[NUM_AGENTS, *shape]`` per entry, in wide ranges."""
    observation: dict[str, NDArray[Any]] = {}
    for entry in model.observation:
        shape = (NUM_AGENTS, *entry.shape)
        if entry.dtype == "float32":
            observation[entry.name] = 2 * rng.standard_normal(shape, np.float32)
        else:
            values = rng.integers(0, 256, shape)
            observation[entry.name] = values.astype(entry.numpy_dtype)
    return observation


def draw_mask(model: PolicyModel, rng: np.random.Generator) -> NDArray[np.bool_] | None:
    """Return a mask that leaves at least one choice of each component."""
    if not model.has_action_mask:
        return None
    parts: list[NDArray[np.bool_]] = []
    for n in model.spec.nvec:
        part = rng.random((NUM_AGENTS, n)) < 0.5
        part[np.arange(NUM_AGENTS), rng.integers(0, n, NUM_AGENTS)] = True
        parts.append(part)
    return np.concatenate(parts, axis=1)


def make_cases(model: PolicyModel) -> dict[str, Any]:
    """Return a sequence of steps, each with what goes in and what must come out."""
    rng = np.random.default_rng(99)
    runner = ModelRunner(model)
    memory = np.zeros((NUM_AGENTS, runner.memory_size), np.float32)
    stack = FrameStack(model.observation, model.frames, NUM_AGENTS)
    steps: list[dict[str, Any]] = []
    for begins in BEGINS:
        memory[begins] = 0.0
        observation, mask = draw_observation(model, rng), draw_mask(model, rng)
        before = memory if runner.memory_size else None
        seen = stack.push(observation, np.isin(np.arange(NUM_AGENTS), begins))
        outputs, _ = runner.outputs(seen, before)
        actions, after = runner.act(seen, mask, before)
        memory = memory if after is None else after
        steps.append(
            {
                "begins": begins,
                "observation": {n: x.reshape(len(x), -1).tolist() for n, x in observation.items()},
                "action_mask": None if mask is None else mask.astype(int).tolist(),
                "outputs": outputs.tolist(),
                "memory": None if after is None else after.tolist(),
                "discrete": actions.discrete.tolist(),
                "continuous": actions.continuous.tolist(),
            }
        )
    return {"policy": model.policy, "num_agents": NUM_AGENTS, "steps": steps}


def read_cases(name: str) -> dict[str, Any]:
    return json.loads(cases_path(name).read_text(encoding="utf-8"))


def write_all() -> int:
    """Write every golden policy with its cases; returns how many."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name, make in MODELS.items():
        model = make()
        write_model(model_path(name), model)
        text = json.dumps(make_cases(model), separators=(",", ":"))
        cases_path(name).write_text(text + "\n", encoding="utf-8")
    return len(MODELS)


if __name__ == "__main__":
    sys.stdout.write(f"{write_all()} golden policies written to {FOLDER}\n")
