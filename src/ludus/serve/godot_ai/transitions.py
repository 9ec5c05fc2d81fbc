"""From what a game submits, ``{"replays": [{"state", "action", …}]}``, to what SAC learns from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from ludus.algorithms.replay import Sample
from ludus.errors import GameError, LudusError
from ludus.networks.tensors import as_tensor
from ludus.serve.godot_ai.agent import ENTRY, Agent
from ludus.serve.godot_ai.fields import Fields, as_finite, as_numbers, short

__all__ = ["Submitted", "read_replays"]

Row = tuple[int, dict[str, Any]]
"""Index in the file, and the row."""


@dataclass(frozen=True)
class Submitted:
    """What of a file can be learnt from.

    Attributes:
        transitions: By agent.
        num_rows: Replays in the file.
        num_wrong: Those that were left out.
        first_error: What is wrong with the first of them; None if nothing is.
    """

    transitions: dict[str, Sample]
    num_rows: int
    num_wrong: int
    first_error: LudusError | None


def read_replays(file: Fields, agents: Mapping[str, Agent]) -> Submitted:
    """Return all replays of a file that are right.

    Raises:
        ProtocolError: The file is not a list of replays at all.
    """
    rows = file.items("replays")
    groups: dict[str, list[Row]] = {}
    errors: dict[int, LudusError] = {}
    for index, row in enumerate(rows):
        try:
            groups.setdefault(_agent_name(row, index, agents), []).append((index, row))
        except LudusError as error:
            errors[index] = error
    transitions: dict[str, Sample] = {}
    for name, group in groups.items():
        sample = _all_at_once(group, agents[name])
        if sample is None:
            sample = _one_by_one(group, agents[name], errors)
        if sample is not None:
            transitions[name] = sample
    first = errors[min(errors)] if errors else None
    return Submitted(transitions, len(rows), len(errors), first)


def _agent_name(row: Any, index: int, agents: Mapping[str, Agent]) -> str:
    fields = _fields(row, index)
    name = fields.text("agent_name")
    if name not in agents:
        raise unknown_agent(name, agents, fields.where)
    return name


def unknown_agent(name: str, agents: Mapping[str, Agent], where: str) -> GameError:
    """Return the error that no agent has this name."""
    known = ", ".join(agents) or "none yet"
    return GameError(
        f"{where}: there is no agent {short(name)}; agents: {known}", "send init for it first"
    )


def _fields(row: Any, index: int) -> Fields:
    return Fields(row, f"replays[{index}]")


def _all_at_once(rows: Sequence[Row], agent: Agent) -> Sample | None:
    """Return the transitions of right rows; None if any may be wrong."""
    try:
        sizes = {"state": agent.settings.state_size, "action": agent.settings.action_size}
        sizes["state_"] = sizes["state"]
        columns = {
            name: _matrix([row[name] for _, row in rows], size) for name, size in sizes.items()
        }
        rest = _matrix([[row["reward"], row["done"]] for _, row in rows], 2)
    except (KeyError, TypeError, ValueError, OverflowError, GameError):
        return None
    is_flag = (rest[:, 1] == 0) | (rest[:, 1] == 1)
    return _sample(columns, rest[:, 0], rest[:, 1] == 1) if is_flag.all() else None


def _matrix(rows: list[Any], size: int) -> NDArray[np.float32]:
    """Return ``float32[n, size]``; raise ``ValueError`` unless all are finite numbers."""
    values = np.array(rows)
    if values.dtype.kind not in "iuf" or values.shape != (len(rows), size):
        raise ValueError("not a matrix of numbers")
    return as_finite(values.ravel(), "").reshape(values.shape)


def _one_by_one(rows: Sequence[Row], agent: Agent, errors: dict[int, LudusError]) -> Sample | None:
    """Return the transitions of the right rows, and add what is wrong with the others."""
    right: list[Row] = []
    for index, row in rows:
        try:
            right.append((index, _checked(_fields(row, index), agent)))
        except LudusError as error:
            errors[index] = error
    return _all_at_once(right, agent) if right else None


def _checked(fields: Fields, agent: Agent) -> dict[str, Any]:
    """Return a row in its simplest form.

    Raises:
        ProtocolError: A part is missing or of another type.
        GameError: It has another length, NaN, or something infinite.
    """
    done = fields.get("done")
    if done not in (0, 1):
        raise fields.unexpected("done", "0 or 1", done)
    settings = agent.settings
    return {
        "state": _vector(fields, "state", settings.state_size),
        "action": _vector(fields, "action", settings.action_size),
        "state_": _vector(fields, "state_", settings.state_size),
        "reward": float(as_numbers([fields.get("reward")], f"{fields.where}.reward")[0]),
        "done": int(done),
    }


def _vector(fields: Fields, key: str, size: int) -> NDArray[np.float32]:
    numbers = as_numbers(fields.get(key), f"{fields.where}.{key}")
    if len(numbers) != size:
        raise GameError(
            f"{fields.where}.{key} has {len(numbers)} numbers, expected {size}",
            "get_state_dim and get_action_dim must say how many there are",
        )
    return numbers


def _sample(
    columns: Mapping[str, NDArray[np.float32]],
    reward: NDArray[np.float32],
    is_terminated: NDArray[np.bool_],
) -> Sample:
    return Sample(
        observation={ENTRY: as_tensor(columns["state"])},
        next_observation={ENTRY: as_tensor(columns["state_"])},
        discrete=torch.zeros(len(reward), 0, dtype=torch.int64),
        continuous=as_tensor(columns["action"]),
        reward=as_tensor(reward),
        is_terminated=as_tensor(is_terminated),
        mask=None,
        next_mask=None,
    )
