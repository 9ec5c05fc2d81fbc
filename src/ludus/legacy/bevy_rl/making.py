"""Reach programs made with bevy_rl for ``ludus.make("http://…")``."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.util import find_spec
from typing import Any

from ludus.errors import ConfigError, SetupError, TargetError
from ludus.extras import install_hint
from ludus.legacy.addresses import GameAddress, check_one_game, read_address
from ludus.legacy.bevy_rl.game import BevyRlGame, Client
from ludus.legacy.bevy_rl.http import HttpConversation
from ludus.legacy.bevy_rl.observing import Observing
from ludus.legacy.game import Declaration

__all__ = ["Settings", "open_game", "to_json"]


def to_json(action: Any) -> str:
    """Return an action as JSON: a number, or a list of numbers."""
    return json.dumps(action.tolist() if hasattr(action, "tolist") else action)


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What a user can set of a program made with bevy_rl.

    Attributes:
        action_space: What one agent does.
        observation_space: What one agent sees: a box, or a dictionary of boxes.
        num_agents: Agents of the program; None: taken from its answer to a reset.
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
    """

    action_space: Any
    observation_space: Any
    num_agents: int | None = None
    to_action: Callable[[Any], str] = to_json
    get_observation: Callable[[Any, int], Any] | None = None
    with_pixels: bool = False
    steps_per_second: float = 60.0
    settle_s: float = 0.0
    start_timeout_s: float = 10.0
    step_timeout_s: float = 60.0


def open_game(address: GameAddress, settings: Settings) -> BevyRlGame:
    """Connect to a program that runs.

    Args:
        address: Where it listens: ``HOST:PORT``.
        settings: Those of the user.

    Raises:
        ConfigError: A setting cannot be used.
        TargetError: The target is not an address.
        SetupError: A package is missing.
        EngineError: Nobody listens there, or it is something else.
    """
    check_one_game(
        address, has_free_port=False, hint="start several programs, and make an environment of each"
    )
    with_pixels = settings.with_pixels
    observing = Observing(
        settings.observation_space, settings.get_observation, with_pixels=with_pixels
    )
    if with_pixels and find_spec("PIL") is None:
        raise SetupError(
            "pictures of bevy_rl programs need the package pillow",
            hint=install_hint("bevy_rl"),
        )
    if settings.num_agents is not None and settings.num_agents < 1:
        raise ConfigError(f"num_agents is {settings.num_agents}, expected 1 or more")
    found = read_address(replace(address, address=address.address.rstrip("/")))
    if not isinstance(found, tuple):
        raise TargetError(f"{address.address!r} is not an address", hint="http://HOST:PORT")
    conversation = HttpConversation(found, settings.start_timeout_s, settings.step_timeout_s)
    try:
        client = Client(conversation, with_pixels=with_pixels)
        declaration = Declaration(
            name=f"http://{address.address}",
            observation_space=settings.observation_space,
            action_space=settings.action_space,
            num_agents=settings.num_agents or len(client.reset()),
            steps_per_second=settings.steps_per_second,
        )
    except BaseException:
        conversation.close()
        raise
    return BevyRlGame(declaration, client, observing, settings.to_action, settings.settle_s)
