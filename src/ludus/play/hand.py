"""A person at the keyboard, whose actions the game reads and a trainer steps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

import numpy as np

from ludus.errors import ActionError, GameError, TargetError
from ludus.play.players import Act
from ludus.pool import EnginePool
from ludus.spec import DiscreteAction, PolicySpec
from ludus.spec.batch import ActionBatch, Batches

__all__ = ["hand_player"]

METHOD = "get_manual_action"


def hand_player(pool: EnginePool) -> Act:
    """Act as a person does, by the ``get_manual_action()`` of each agent.

    Args:
        pool: One engine with a window, at the speed of the game.

    Returns:
        Asks the game for the action of every active agent; where it says null, nobody plays, and
        the agent does what 0 means.
    """

    def act(batches: Batches) -> Mapping[str, ActionBatch]:
        return {name: _act(pool, spec, batches) for name, spec in pool.policies.items()}

    return act


def _act(pool: EnginePool, spec: PolicySpec, batches: Batches) -> ActionBatch:
    """Return the actions of all agents of a policy.

    Raises:
        TargetError: The game has no such method.
        ActionError: It returns something else than an action.
    """
    batch = ActionBatch.zeros(spec, pool.num_agents(spec.name))
    for slot in batches[spec.name].active.nonzero()[0].tolist():
        agent = spec.agents[slot]
        try:
            target = {"world": agent.world, "agent": agent.path}
            (value,) = pool.call(target, METHOD)
        except GameError as error:
            raise TargetError(
                f"nobody can play policy {spec.name} by hand: {error.message}",
                f"give the agent a method {METHOD}(), or use --policy or --random",
            ) from error
        if value is not None:
            _write_action(spec, value, batch, slot)
    return batch


def _write_action(spec: PolicySpec, value: Any, batch: ActionBatch, slot: int) -> None:
    """Write an action as games have them: a number, a list, or a dictionary by component."""
    parts: list[Any] = [value]
    if isinstance(value, Mapping):
        named = cast(Mapping[str, Any], value)
        parts = [named.get(part.name) for part in spec.action]
    elif isinstance(value, list):
        parts = cast(list[Any], value)
    try:
        if isinstance(value, Mapping):
            kinds = [isinstance(part, DiscreteAction) for part in spec.action]
            pairs = list(zip(kinds, parts, strict=True))
            choices = [part for is_choice, part in pairs if is_choice]
            numbers = np.hstack([part for is_choice, part in pairs if not is_choice])
        else:
            choices, numbers = (parts, []) if spec.num_discrete else ([], parts)
        batch.discrete[slot] = [int(choice) for choice in choices]
        batch.continuous[slot] = np.asarray(numbers, np.float32)
    except (TypeError, ValueError) as error:
        raise ActionError(
            f"{METHOD}() of policy {spec.name} returned {value!r}, which is not an action: {error}"
        ) from None
