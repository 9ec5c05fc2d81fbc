"""What an agent sees of the program's state, and of its picture."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, cast

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ludus.errors import GameError
from ludus.legacy.bevy_rl.pictures import PIXELS, image_space, split_picture

__all__ = ["Observing"]

GetObservation = Callable[[Any, int], Any]
_EXCERPT = 200
_HINT = "get_observation=function(state, agent) says what an agent sees"


class Observing:
    """Makes elements of the observation space out of states and pictures.

    Args:
        space: Of one agent: a box, or a dictionary of boxes.
        get_observation: The user's own way; None takes numbers as they come in the JSON.
        with_pixels: The space, or its entry ``pixels``, is the agent's picture.

    Raises:
        ConfigError: The space has no place for pictures.
    """

    def __init__(
        self,
        space: spaces.Space[Any],
        get_observation: GetObservation | None,
        *,
        with_pixels: bool,
    ) -> None:
        self._image = image_space(space) if with_pixels else None
        self._has_state = self._image is not space
        self._get_observation = get_observation
        self._box: Any = space
        self._entries: dict[str, Any] | None = None
        if isinstance(space, spaces.Dict):
            entries: dict[str, Any] = dict(cast("Any", space).spaces)
            if self._image is not None:
                del entries[PIXELS]
            self._entries = entries

    def observe(self, state: Any, picture: bytes, num_agents: int) -> list[Any]:
        """Return one observation per agent.

        Raises:
            GameError: State or picture do not fit the space.
        """
        if self._image is None:
            return [self._own_state(state, agent, num_agents) for agent in range(num_agents)]
        images: list[NDArray[np.uint8]] = split_picture(picture, self._image, num_agents)
        if not self._has_state:
            return list(images)
        return [
            {**self._own_state(state, agent, num_agents), PIXELS: image}
            for agent, image in enumerate(images)
        ]

    def _own_state(self, state: Any, agent: int, num_agents: int) -> Any:
        if state is None:
            raise GameError(
                "the program has not published a state yet",
                hint="it calls set_env_state when EventPause comes, which must be before the "
                "answer to a reset",
            )
        if self._get_observation is not None:
            return self._get_observation(state, agent)
        part = _part_of_agent(state, agent, num_agents)
        if self._entries is None:
            return _fit(part, self._box, "the state")
        values = _mapping(part)
        if values is None:
            raise GameError(f"the state of agent {agent} is not a JSON object: {part}", hint=_HINT)
        return {name: _fit(_entry(values, name), box, name) for name, box in self._entries.items()}


def _part_of_agent(state: Any, agent: int, num_agents: int) -> Any:
    """Return what belongs to one agent: an element of the list that has one for each."""
    values = _mapping(state)
    if num_agents == 1 and (values is None or len(values) > 1):
        return state
    candidates = [state] if values is None else list(values.values())
    lists = [cast("list[Any]", one) for one in candidates if isinstance(one, list)]
    fitting = [one for one in lists if len(one) == num_agents]
    if len(fitting) == 1:
        return fitting[0][agent]
    if num_agents == 1:
        return state
    raise GameError(
        f"the state has {len(fitting)} lists of {num_agents} elements, expected 1, with an element "
        f"for each agent: {str(state)[:_EXCERPT]}",
        hint=_HINT,
    )


def _mapping(value: Any) -> Mapping[str, Any] | None:
    return cast("Mapping[str, Any]", value) if isinstance(value, Mapping) else None


def _entry(values: Mapping[str, Any], name: str) -> Any:
    if name not in values:
        known = ", ".join(values) or "nothing"
        raise GameError(f"the state has no {name!r}, it has {known}", hint=_HINT)
    return values[name]


def _fit(value: Any, space: Any, name: str) -> NDArray[Any]:
    """Return all numbers of a JSON value, in their order, as an element of a box."""
    numbers = list(_numbers(value, name))
    shape: tuple[int, ...] = space.shape
    size = int(np.prod(shape))
    if len(numbers) != size:
        raise GameError(
            f"{name} has {len(numbers)} numbers, the space {size}: {str(value)[:_EXCERPT]}",
            hint=_HINT,
        )
    try:
        return np.array(numbers, dtype=space.dtype).reshape(shape)
    except (OverflowError, ValueError) as error:
        raise GameError(f"{name} does not fit {space}: {error}", hint=_HINT) from error


def _numbers(value: Any, name: str) -> Iterator[float]:
    if isinstance(value, int | float):
        yield value
    elif isinstance(value, list):
        for inner in cast("list[Any]", value):
            yield from _numbers(inner, name)
    elif (values := _mapping(value)) is not None:
        for key, inner in values.items():
            yield from _numbers(inner, f"{name}.{key}")
    elif value is None:
        # What serde makes of NaN and infinity; the session says where it came from.
        yield float("nan")
    else:
        raise GameError(f"{name} is not a number: {value!r}", hint=_HINT)
