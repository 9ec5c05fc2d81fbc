"""Open games for godot_gym_api for ``ludus.make("godot_gym_api:…")``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ludus.errors import ConfigError
from ludus.legacy.game import Declaration
from ludus.legacy.godot_gym_api.client import GodotClient
from ludus.legacy.godot_gym_api.declared_game import DeclaredGame
from ludus.legacy.godot_gym_api.declaring import check_spaces, read_functions
from ludus.legacy.godot_gym_api.messages import (
    AGENT_KEY,
    ENVIRONMENT_KEY,
    WORLD_KEY,
    State,
)
from ludus.legacy.places import check_one_game, read_place
from ludus.legacy.registry import GameAddress

__all__ = ["open_game"]

_USUAL_ADDRESS = ("127.0.0.1", 9090)
Configuration = Mapping[str, Mapping[str, Any]]


def open_game(
    place: GameAddress,
    *,
    action_space: Any,
    observation_space: Any,
    get_reward: Callable[[State], float],
    is_terminated: Callable[[State], bool],
    get_observation: Callable[[State], Any] | None = None,
    requested_observation: Mapping[str, Any] | None = None,
    configuration: Configuration | None = None,
    protobuf_message_module: Any = None,
    engine_address: tuple[str, int] | None = None,
    command: str | None = None,
    frames_per_second: int = 60,
    is_windowed: bool = False,
    max_answer_bytes: int = 1 << 26,
    start_timeout_s: float = 60.0,
    step_timeout_s: float = 60.0,
) -> DeclaredGame:
    """Start a game, or connect with one; the arguments of :func:`.making.make`.

    Args:
        place: A project or scene to start, or host and port at which a game listens: one that
            ``command`` starts, or that somebody else starts.
        action_space: What the game's ``set_action`` takes.
        observation_space: What ``get_observation`` returns.
        get_reward: Returns the reward for a state ``{"agent": data, "world": data}``.
        is_terminated: Returns whether the episode has ended in a state.
        get_observation: Returns the observation for a state; None: fields by name.
        requested_observation: What the game is asked for.
        configuration: Told once at the beginning.
        protobuf_message_module: The compiled messages; None if the game answers in JSON.
        engine_address: Where a project that we start listens; port 0 takes a free one.
        command: What the shell runs to start the game.
        frames_per_second: Frames in one second of game time, of a game that we start.
        is_windowed: Whether a game that we start draws.
        max_answer_bytes: Longest answer that the game may send.
        start_timeout_s: How long it may take until the game listens, seconds.
        step_timeout_s: How long an answer may take, seconds.

    Raises:
        ConfigError: A setting cannot be used.
        TargetError: There is no such project.
        EngineError: The game did not start, or never listened.
    """
    check_spaces(action_space, observation_space)
    functions = read_functions(observation_space, get_observation, get_reward, is_terminated)
    client = GodotClient(
        protobuf_message_module,
        **_whereabouts(place, engine_address, command),
        frames_per_second=frames_per_second,
        is_windowed=is_windowed,
        max_answer_bytes=max_answer_bytes,
        start_timeout_s=start_timeout_s,
        step_timeout_s=step_timeout_s,
        log_path=place.log_path,
        cores=place.cores,
    )
    _configure(client, configuration)
    declaration = Declaration(
        name=f"godot_gym_api:{place.address}",
        observation_space=observation_space,
        action_space=action_space,
        steps_per_second=frames_per_second / _repeat_action(configuration),
    )
    requested = requested_observation or {AGENT_KEY: [], WORLD_KEY: []}
    return DeclaredGame(client, declaration, functions, requested)


def _whereabouts(
    place: GameAddress, engine_address: tuple[str, int] | None, command: str | None
) -> dict[str, Any]:
    """Return how the game is started, and where it listens, as a client takes it."""
    found = read_place(place)
    if isinstance(found, Path):
        address = engine_address or _USUAL_ADDRESS
    elif engine_address is None:
        address = found
    else:
        raise ConfigError(
            f"two addresses are given: {place.address} and engine_address {engine_address}",
            hint="engine_address is for a project: godot_gym_api:PATH",
        )
    target = found if isinstance(found, Path) else None
    is_ours = target is not None or command is not None
    check_one_game(
        place,
        has_free_port=is_ours and address[1] == 0,
        hint="with our classes in the game (docs/godot_gym_api.md), port 0 takes a free one: "
        'godot_gym_api:PATH with engine_address=("127.0.0.1", 0)',
    )
    return {"engine_address": address, "target": target, "command": command}


def _configure(client: GodotClient, configuration: Configuration | None) -> None:
    if not configuration:
        return
    try:
        client.configure(configuration)
    except BaseException:
        client.close()
        raise


def _repeat_action(configuration: Configuration | None) -> float:
    """Return how many physics frames a step lasts, for all we know; at least 1."""
    environment = (configuration or {}).get(ENVIRONMENT_KEY, {})
    frames = environment.get("repeat_action", GodotClient.DEFAULT_REPEAT_ACTION)
    return max(1.0, float(frames)) if isinstance(frames, int | float) else 1.0
