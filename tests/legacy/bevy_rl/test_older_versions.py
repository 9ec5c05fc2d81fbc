"""Programs made with bevy_rl 0.8.4 to 0.10.0-beta, which route and answer in another way.

A stand-in has the routes of those versions, since Bevy 0.8 to 0.10 can hardly be built today.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Generator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, ClassVar
from urllib.parse import parse_qs, urlsplit

import numpy as np
import pytest
from gymnasium import spaces

import ludus
from ludus.errors import GameError

_SETTINGS: dict[str, Any] = {
    "action_space": spaces.Discrete(2),
    "observation_space": spaces.Box(-np.inf, np.inf, (1,)),
    "start_timeout_s": 10.0,
    "step_timeout_s": 10.0,
}


class _OldProgram(BaseHTTPRequestHandler):
    """A counter that an action moves; its reward is where it is.

    As the documents of those versions write a game, it sends a step's result when its timer has
    run out, whether or not a step was asked for. So the first step is answered by what was sent
    before it, and each one after it is late by one, too.
    """

    protocol_version = "HTTP/1.1"
    routes: ClassVar[dict[str, str]] = {"/state": "GET", "/step": "GET", "/reset": "POST"}
    requests: list[str]
    place = 0
    next_place = 0

    def do_GET(self) -> None:  # the name that http.server calls
        path = urlsplit(self.path)
        type(self).requests.append(f"{self.command} {path.path}")
        if self.routes.get(path.path) != self.command:
            self.send_response(405)
            self.send_header("allow", self.routes.get(path.path, ""))
            self.send_header("content-length", "0")
            self.end_headers()
            return
        getattr(self, f"_answer_{path.path[1:]}")(path.query)

    do_POST = do_GET  # noqa: N815

    def _answer_state(self, _: str) -> None:
        self._answer({"place": self.place})

    def _answer_reset(self, _: str) -> None:
        type(self).place = type(self).next_place = 0
        self._answer([self._agent()])

    def _answer_step(self, query: str) -> None:
        type(self).place = self.next_place
        (action,) = json.loads(parse_qs(query)["payload"][0])
        type(self).next_place += int(action["action"])
        self._answer([self._agent()])

    def _agent(self) -> dict[str, Any]:
        return {"reward": float(self.place), "is_terminated": False}

    def _answer(self, value: Any) -> None:
        body = json.dumps(value).encode()
        self.send_response(200)
        self.send_header("content-length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        pass


@contextmanager
def _running(**fields: Any) -> Generator[tuple[str, list[str]]]:
    """Yield the address of a stand-in, and the requests that come."""
    requests: list[str] = []
    kind = type("Program", (_OldProgram,), {"requests": requests, **fields})
    with ThreadingHTTPServer(("127.0.0.1", 0), kind) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}", requests
        finally:
            server.shutdown()
            thread.join(10.0)


def test_reset_is_posted_where_get_is_refused_and_that_is_remembered() -> None:
    with _running() as (url, requests):
        env = ludus.make(url, **_SETTINGS)
        for _ in range(2):
            observation, _ = env.reset()
            assert observation.tolist() == [0.0]
        env.close()
    resets = [request for request in requests if request.endswith("/reset")]
    assert resets == ["GET /reset"] + ["POST /reset"] * (len(resets) - 1)


def test_steps_of_programs_as_documented_then_are_late_by_one() -> None:
    with _running() as (url, _):
        env = ludus.make(url, **_SETTINGS)
        env.reset()
        steps = [env.step(1) for _ in range(3)]
        env.close()
    assert [observation.tolist() for observation, *_ in steps] == [[0.0], [1.0], [2.0]]
    assert [reward for _, reward, *_ in steps] == [0.0, 1.0, 2.0]


def test_reset_that_neither_method_reaches_is_an_error() -> None:
    with (
        _running(routes={"/state": "GET"}) as (url, _),
        pytest.raises(GameError, match="/reset was answered with status 405"),
    ):
        ludus.make(url, **_SETTINGS)
