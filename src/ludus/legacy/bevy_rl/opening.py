"""Reach programs made with bevy_rl for ``ludus.make("http://…")``."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

from ludus.errors import ConfigError, SetupError, TargetError
from ludus.legacy.bevy_rl.client import Client
from ludus.legacy.bevy_rl.connection import Connection
from ludus.legacy.bevy_rl.declared_game import DeclaredGame, to_json
from ludus.legacy.bevy_rl.observing import Observing
from ludus.legacy.game import Declaration
from ludus.legacy.places import check_one_game, read_place
from ludus.legacy.registry import GameAddress

__all__ = ["open_game"]


def open_game(
    place: GameAddress,
    *,
    action_space: Any,
    observation_space: Any,
    num_agents: int | None = None,
    to_action: Callable[[Any], str] = to_json,
    get_observation: Callable[[Any, int], Any] | None = None,
    with_pixels: bool = False,
    steps_per_second: float = 60.0,
    settle_s: float = 0.0,
    start_timeout_s: float = 10.0,
    step_timeout_s: float = 60.0,
) -> DeclaredGame:
    """Connect to a program that runs.

    Args:
        place: Where it listens: ``HOST:PORT``.
        action_space: What one agent does.
        observation_space: What one agent sees: a box, or a dictionary of boxes.
        num_agents: Agents of the program; None: its answer to a reset tells.
        to_action: Makes the text that the program gets, out of an action; JSON unless told
            otherwise: ``2`` or ``[0.5, -1.0]``.
        get_observation: Makes the observation of an agent (0, 1, …) out of the program's state as
            JSON. Unless told otherwise, the numbers of the state as they come: all of them, or
            those of the agent's element if the state has one list with an element for each agent;
            of a dictionary space, each entry by its name.
        with_pixels: Whether the observation space, or its entry ``pixels``, is the agent's
            picture: uint8, (height, width, channels).
        steps_per_second: Steps in one second of game time.
        settle_s: How long to wait after a reset before the first look, seconds: for programs that
            answer a reset before they have published the new state.
        start_timeout_s: How long to wait for a program that does not listen yet, seconds.
        step_timeout_s: How long an answer may take, seconds.

    Raises:
        ConfigError: A setting cannot be used.
        TargetError: The target is no address.
        SetupError: A package is missing.
        EngineError: Nobody listens there, or it is something else.
    """
    check_one_game(
        place, has_free_port=False, hint="start several programs, and make an environment of each"
    )
    observing = Observing(observation_space, get_observation, with_pixels=with_pixels)
    if with_pixels:
        _check_packages()
    if num_agents is not None and num_agents < 1:
        raise ConfigError(f"num_agents is {num_agents}, expected 1 or more")
    host, port = _read_address(place)
    connection = Connection(host, port, start_timeout_s, step_timeout_s)
    try:
        client = Client(connection, with_pixels=with_pixels)
        declaration = Declaration(
            name=f"http://{place.address}",
            observation_space=observation_space,
            action_space=action_space,
            num_agents=num_agents or len(client.reset()),
            steps_per_second=steps_per_second,
        )
    except BaseException:
        connection.close()
        raise
    return DeclaredGame(client, declaration, observing, to_action, settle_s)


def _read_address(place: GameAddress) -> tuple[str, int]:
    bare = GameAddress(address=place.address.rstrip("/"))
    found = read_place(bare)
    if not isinstance(found, tuple):
        raise TargetError(f"{place.address!r} is no address", hint="http://HOST:PORT")
    return found


def _check_packages() -> None:
    if find_spec("PIL") is None:
        raise SetupError(
            "pictures of bevy_rl programs need the package pillow",
            hint="pip install ludus-rl[bevy_rl]",
        )
