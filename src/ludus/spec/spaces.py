"""Gymnasium spaces from a spec, and actions from spaces to the wire."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, cast

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ludus.errors import ActionError
from ludus.spec import ContinuousAction, DiscreteAction, ObservationEntry, PolicySpec
from ludus.spec.batch import ActionBatch

__all__ = ["action_space", "actions_of", "observation_of", "observation_space", "to_action_batch"]

FLAT_ENTRY = "observation"
_HINT = "action_space.sample() of the environment shows the form"


def observation_space(policy: PolicySpec) -> spaces.Space[Any]:
    """Return a ``Box`` for the one entry called "observation", else a ``Dict`` of boxes."""
    if is_flat(policy):
        return _box(policy.observation[0])
    return spaces.Dict({entry.name: _box(entry) for entry in policy.observation})


def action_space(policy: PolicySpec) -> spaces.Space[Any]:
    """Return the space of one agent's action.

    One choice: ``Discrete``; several: ``MultiDiscrete``; numbers: ``Box``; both kinds: a ``Dict``
    by component name.
    """
    nvec = policy.nvec
    if policy.continuous_size == 0:
        return spaces.Discrete(nvec[0]) if len(nvec) == 1 else spaces.MultiDiscrete(list(nvec))
    if not nvec:
        low, high = policy.continuous_bounds()
        return spaces.Box(low, high, dtype=np.float32)
    return spaces.Dict({part.name: _component_space(part) for part in policy.action})


def observation_of(
    policy: PolicySpec, entries: Mapping[str, NDArray[Any]]
) -> NDArray[Any] | dict[str, NDArray[Any]]:
    """Return entries in the form of :func:`observation_space`, batched or not; no copies."""
    return entries[FLAT_ENTRY] if is_flat(policy) else dict(entries)


def to_action_batch(policy: PolicySpec, actions: Any, num_agents: int | None) -> ActionBatch:
    """Turn actions of :func:`action_space` into wire form.

    Args:
        policy: Whose actions.
        actions: A batch of them, or the action of one agent.
        num_agents: Size of the batch; None if it is not a batch, but one action.

    Raises:
        ActionError: Wrong shape, not finite, or a choice out of range.
    """
    if policy.continuous_size and policy.nvec:
        batch = _from_dict(policy, actions, num_agents)
    elif policy.nvec:
        shape = () if policy.num_discrete == 1 else (policy.num_discrete,)
        discrete = _discrete(actions, num_agents, shape)
        batch = ActionBatch(discrete, np.zeros((len(discrete), 0), "f4"))
    else:
        continuous = _continuous(actions, num_agents, policy.continuous_size)
        batch = ActionBatch(np.zeros((len(continuous), 0), np.int64), continuous)
    _check(policy, batch)
    return batch


def actions_of(policy: PolicySpec, batch: ActionBatch) -> Any:
    """Return actions in wire form as batched actions of :func:`action_space`; no copies."""
    discrete, continuous = batch.discrete, batch.continuous
    if policy.continuous_size and policy.nvec:
        parts: dict[str, NDArray[Any]] = {}
        choice = start = 0
        for part in policy.action:
            if isinstance(part, DiscreteAction):
                parts[part.name] = discrete[:, choice]
                choice += 1
            else:
                parts[part.name] = continuous[:, start : start + part.size]
                start += part.size
        return parts
    if policy.continuous_size:
        return continuous
    return discrete[:, 0] if policy.num_discrete == 1 else discrete


def is_flat(policy: PolicySpec) -> bool:
    """Whether the observation is one array rather than a dictionary."""
    return len(policy.observation) == 1 and policy.observation[0].name == FLAT_ENTRY


def _box(entry: ObservationEntry) -> spaces.Box:
    low, high = entry.bounds()
    return spaces.Box(low, high, entry.shape, dtype=cast(Any, entry.numpy_dtype.type))


def _component_space(part: DiscreteAction | ContinuousAction) -> spaces.Space[Any]:
    if isinstance(part, DiscreteAction):
        return spaces.Discrete(part.n)
    low = np.broadcast_to(np.asarray(part.low, np.float32), (part.size,))
    high = np.broadcast_to(np.asarray(part.high, np.float32), (part.size,))
    return spaces.Box(low, high, dtype=np.float32)


def _discrete(
    values: Any, num_agents: int | None, shape: tuple[int, ...], name: str = "action"
) -> NDArray[np.int64]:
    array = np.asarray(values)
    if array.dtype.kind not in "iu":
        raise ActionError(f"{name}: expected whole numbers, got {array.dtype}", hint=_HINT)
    return _as_rows(array.astype(np.int64, copy=False), num_agents, shape, name)


def _continuous(
    values: Any, num_agents: int | None, size: int, name: str = "action"
) -> NDArray[np.float32]:
    return _as_rows(np.asarray(values, dtype=np.float32), num_agents, (size,), name)


def _as_rows(
    array: NDArray[Any], num_agents: int | None, shape: tuple[int, ...], name: str
) -> NDArray[Any]:
    """Return actions, of ``shape`` for each agent, with one row per agent."""
    expected = shape if num_agents is None else (num_agents, *shape)
    is_other_batch = num_agents is not None and array.ndim > 0 and len(array) != num_agents
    if array.size != math.prod(expected) or is_other_batch:
        raise ActionError(f"{name}: expected shape {expected}, got {array.shape}", hint=_HINT)
    return array.reshape(1 if num_agents is None else num_agents, math.prod(shape))


def _from_dict(policy: PolicySpec, actions: Any, num_agents: int | None) -> ActionBatch:
    if not isinstance(actions, Mapping):
        raise ActionError(
            f"expected a dictionary of actions, got {type(actions).__name__}", hint=_HINT
        )
    values = cast(Mapping[str, Any], actions)
    missing = [part.name for part in policy.action if part.name not in values]
    if missing:
        raise ActionError(f"the action lacks {', '.join(missing)}", hint=_HINT)
    discrete = [
        _discrete(values[part.name], num_agents, (), part.name)
        for part in policy.action
        if isinstance(part, DiscreteAction)
    ]
    continuous = [
        _continuous(values[part.name], num_agents, part.size, part.name)
        for part in policy.action
        if isinstance(part, ContinuousAction)
    ]
    return ActionBatch(np.concatenate(discrete, axis=1), np.concatenate(continuous, axis=1))


def _check(policy: PolicySpec, batch: ActionBatch) -> None:
    if batch.continuous.size and not np.isfinite(batch.continuous).all():
        raise ActionError(f"{policy.name}: an action is NaN or infinite")
    if not batch.discrete.size:
        return
    out_of_range = (batch.discrete < 0) | (batch.discrete >= np.asarray(policy.nvec))
    if out_of_range.any():
        slot, part = (int(i) for i in np.argwhere(out_of_range)[0])
        raise ActionError(
            f"{policy.name}: action {batch.discrete[slot, part]} of agent {slot} is out of range "
            f"0 to {policy.nvec[part] - 1}"
        )
