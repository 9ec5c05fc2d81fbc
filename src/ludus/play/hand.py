"""A person at the keyboard, whose actions the game reads and a trainer steps."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import islice
from typing import Any, cast

from ludus.errors import ActionError, GameError, TargetError
from ludus.play.players import Act
from ludus.pool import EnginePool
from ludus.spec import ContinuousAction, DiscreteAction, PolicySpec
from ludus.spec.batch import ActionBatch, Batches

__all__ = ["hand_player"]

METHOD = "get_manual_action"
PASS_FRAME = "pass_frame"


def hand_player(pool: EnginePool) -> Act:
    """Act as a person does, by the ``get_manual_action()`` of each agent.

    Args:
        pool: One engine with a window, at the speed of the game.

    Returns:
        A function that asks the game for the action of every active agent. While all answer null,
        the person has not chosen yet: a frame passes without a step, and the game is asked again.
        If only some answer null, those agents take action 0.
    """

    def act(batches: Batches) -> Mapping[str, ActionBatch]:
        policies = pool.policies
        while True:
            said = {name: _ask(pool, spec, batches) for name, spec in policies.items()}
            if _is_decided(said):
                return {name: _join(spec, pool, said[name]) for name, spec in policies.items()}
            _pass_frame(pool)

    return act


def _ask(pool: EnginePool, spec: PolicySpec, batches: Batches) -> dict[int, Any]:
    """Return what the game says of all active agents of a policy, by slot.

    Raises:
        TargetError: The game has no such method.
    """
    said: dict[int, Any] = {}
    for slot in batches[spec.name].active.nonzero()[0].tolist():
        agent = spec.agents[slot]
        try:
            target = {"world": agent.world, "agent": agent.path}
            (said[slot],) = pool.call(target, METHOD)
        except GameError as error:
            raise TargetError(
                f"nobody can play policy {spec.name} by hand: {error.message}",
                f"give the agent a method {METHOD}() (Godot RL Agents: get_action(), and a "
                "set_action() that needs no argument), or use --policy or --random",
            ) from error
    return said


def _is_decided(said: Mapping[str, Mapping[int, Any]]) -> bool:
    values = [value for by_slot in said.values() for value in by_slot.values()]
    return not values or any(value is not None for value in values)


def _pass_frame(pool: EnginePool) -> None:
    try:
        pool.call({"bridge": True}, PASS_FRAME)
    except GameError as error:
        raise TargetError(
            f"{METHOD}() of every agent returned null, and the game's add-on cannot wait for an "
            f"action: {error.message}",
            "let it return an action; or, in Godot 4, run ludus addon install",
        ) from error


def _join(spec: PolicySpec, pool: EnginePool, said: Mapping[int, Any]) -> ActionBatch:
    """Return the actions of all agents of a policy.

    Raises:
        ActionError: The game said something else than an action.
    """
    batch = ActionBatch.zeros(spec, pool.num_agents(spec.name))
    for slot, value in said.items():
        if value is not None:
            _write_action(spec, value, batch, slot)
    return batch


def _write_action(spec: PolicySpec, value: Any, batch: ActionBatch, slot: int) -> None:
    """Write an action as games have them: a number, a list, or a dictionary by component."""
    try:
        said = _by_component(spec, value)
        choices = [
            _read_choice(part, said[part.name])
            for part in spec.action
            if isinstance(part, DiscreteAction)
        ]
        numbers = [
            number
            for part in spec.action
            if isinstance(part, ContinuousAction)
            for number in _read_numbers(part, said[part.name])
        ]
    except (TypeError, ValueError) as error:
        raise ActionError(
            f"{METHOD}() of policy {spec.name} returned {value!r}, which is not an action: {error}"
        ) from None
    batch.discrete[slot] = choices
    batch.continuous[slot] = numbers


def _by_component(spec: PolicySpec, value: Any) -> Mapping[str, Any]:
    """Return what a game said of each component; a list has their numbers one after another.

    Raises:
        ValueError: Something is missing, or too much.
    """
    names = ", ".join(part.name for part in spec.action)
    if isinstance(value, Mapping):
        named = cast(Mapping[str, Any], value)
        missing = [part.name for part in spec.action if part.name not in named]
        if missing:
            raise ValueError(f"it lacks {', '.join(missing)}")
        return named
    if spec.num_discrete and spec.continuous_size:
        raise ValueError(f"expected a dictionary of {names}")
    said = cast(list[Any], value) if isinstance(value, list) else [value]
    size = spec.num_discrete or spec.continuous_size
    if len(said) != size:
        raise ValueError(f"expected {size} numbers for {names}, got {len(said)}")
    if spec.num_discrete:
        return {part.name: number for part, number in zip(spec.action, said, strict=True)}
    rest = iter(said)
    return {
        part.name: list(islice(rest, part.size))
        for part in spec.action
        if isinstance(part, ContinuousAction)
    }


def _read_choice(part: DiscreteAction, said: Any) -> int:
    """Return a choice; games may say it as a float or a bool.

    Raises:
        TypeError: It is not a number.
        ValueError: It is not a number, or it is out of range.
    """
    choice = int(said)
    if not 0 <= choice < part.n:
        raise ValueError(f"{part.name} is {choice}, expected 0 to {part.n - 1}")
    return choice


def _read_numbers(part: ContinuousAction, said: Any) -> list[float]:
    """Return the numbers of a component; one may come without a list.

    Raises:
        TypeError: Something is not a number.
        ValueError: Something is not a number, or the component has more or fewer.
    """
    parts = cast(list[Any], said) if isinstance(said, list) else [said]
    numbers = [float(number) for number in parts]
    if len(numbers) != part.size:
        raise ValueError(f"{part.name} has {len(numbers)} numbers, expected {part.size}")
    return numbers
