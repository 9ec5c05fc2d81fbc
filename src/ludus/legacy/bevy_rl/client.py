"""The four endpoints of bevy_rl, as calls."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any, NamedTuple, cast
from urllib.parse import quote

from ludus.errors import EngineCrashed, EngineTimeout, GameError, ProtocolError
from ludus.legacy.bevy_rl.connection import Connection, Response

__all__ = ["AgentAnswer", "Client"]

_OURS = "bevy_ludus/"
_OK = 200
_ENDED = 503
_LATE = 504
_EXCERPT = 300


class AgentAnswer(NamedTuple):
    """What an answer says of one agent."""

    reward: float
    is_terminated: bool


class Client:
    """Talks to a program made with bevy_rl, or with ``bevy_ludus::rest``.

    The latter sends the state along with the answer to a step; the other is asked for it in a
    second request. That one is not sent together with the first, as the program would then hold
    back the second answer until the first one is acknowledged, which takes 40 ms.

    Args:
        connection: Closed with this object.
        with_pixels: Ask for pictures with every state.

    Raises:
        EngineError: What listens there is no such program, or it fails.
    """

    def __init__(self, connection: Connection, *, with_pixels: bool) -> None:
        self._connection = connection
        self._with_pixels = with_pixels
        self._state_request = connection.request("GET", "/state")
        self._picture_request = connection.request("GET", "/visual_observations")
        connection.send(self._state_request)
        response = connection.receive()
        self._is_ours = response.product.startswith(_OURS)
        _read_json("/state", response)

    def reset(self) -> list[AgentAnswer]:
        """Begin an episode of all agents; :meth:`observe` is next."""
        self._connection.send(self._connection.request("GET", "/reset"))
        return _read_agents("/reset", _read_json("/reset", self._connection.receive()))

    def observe(self) -> tuple[Any, bytes]:
        """Return state and picture; the picture is empty without pixels."""
        self._connection.send(self._state_request)
        state = _read_json("/state", self._connection.receive())
        return state, self._ask_for_picture()

    def send_step(self, actions: Sequence[str | None]) -> None:
        """Begin a step: one text or none per agent; :meth:`receive_step` is next."""
        payload = json.dumps([{"action": action} for action in actions])
        if self._is_ours:
            step = self._connection.request("POST", "/step?include=state", payload.encode())
        else:
            step = self._connection.request("GET", f"/step?payload={quote(payload)}")
        self._connection.send(step)

    def receive_step(self) -> tuple[list[AgentAnswer], Any, bytes]:
        """Return agents, state and picture as they are after the step."""
        answer = _read_json("/step", self._connection.receive())
        if self._is_ours:
            agents = _read_agents("/step", answer["agents"])
            return agents, answer["state"], self._ask_for_picture()
        return _read_agents("/step", answer), *self.observe()

    def close(self) -> None:
        """Close the connection; may be called twice."""
        self._connection.close()

    def _ask_for_picture(self) -> bytes:
        if not self._with_pixels:
            return b""
        self._connection.send(self._picture_request)
        response = self._connection.receive()
        _check_status("/visual_observations", response)
        return response.body


def _check_status(path: str, response: Response) -> None:
    if response.status == _OK:
        return
    reason = response.body.decode(errors="replace")[:_EXCERPT]
    text = f"{path} was answered with status {response.status}: {reason}"
    if response.status == _LATE:
        raise EngineTimeout(text)
    if response.status == _ENDED:
        raise EngineCrashed(text)
    raise GameError(text)


def _read_json(path: str, response: Response) -> Any:
    _check_status(path, response)
    try:
        return json.loads(response.body)
    except ValueError as error:
        # bevy_rl tells its reasons as text, with the status 200.
        text = response.body.decode(errors="replace")[:_EXCERPT]
        raise GameError(f"{path} was not answered with JSON: {text!r}") from error


def _read_agents(path: str, answer: Any) -> list[AgentAnswer]:
    try:
        agents = [_read_agent(one) for one in cast("list[Any]", answer)]
    except (KeyError, TypeError, ValueError):
        agents = []
    if not agents:
        raise ProtocolError(
            f'{path} was answered with {str(answer)[:_EXCERPT]}, expected a list of {{"reward": '
            f'number, "is_terminated": true or false}}, one for each agent',
            hint="is it a program made with bevy_rl that listens there?",
        )
    return agents


def _read_agent(one: Any) -> AgentAnswer:
    reward, is_terminated = one["reward"], one["is_terminated"]
    # NaN and infinity are null in JSON.
    return AgentAnswer(float("nan") if reward is None else float(reward), bool(is_terminated))
