"""A game that is a thread: it guides its training as a test tells it to, right or wrong."""

from __future__ import annotations

import json
import socket
import threading
import time
from collections.abc import Callable
from copy import deepcopy
from typing import Any

from ludus.session.user_token import user_token
from tests.fake_engine import FLAT, HELLO, Talk

__all__ = ["CAPABILITIES", "DEADLINE_S", "EPISODE_STEPS", "Game", "small_spec"]

DEADLINE_S = 30.0
EPISODE_STEPS = 5
CAPABILITIES = [*HELLO["capabilities"], "guided"]
SETTINGS: dict[str, Any] = {"hidden_sizes": [8], "rollout_steps": 16, "epochs": 1,
                            "minibatch_size": 24}  # fmt: skip


def small_spec(**settings: Any) -> dict[str, Any]:
    """Return the spec of three agents whose policy is small and learns quickly."""
    spec = deepcopy(FLAT)
    spec["policies"][0]["settings"] = {**SETTINGS, **settings}
    return spec


class Game:
    """Answers whatever it is asked; an episode lasts :data:`EPISODE_STEPS` and brings as much.

    Attributes:
        statuses: What it was shown.
        events: Names of frames and calls, in the order in which they came; of statuses the state.
        fault: Changes of the content of its answers, or bytes in their place.
        last: What came instead of a request in the end: ``CLOSE``, ``ERROR`` or nothing.
        report: Content of that ``ERROR``.
    """

    def __init__(
        self,
        port: int,
        training: Any = None,
        spec: dict[str, Any] | None = None,
        hello: dict[str, Any] | None = None,
    ) -> None:
        self.statuses: list[dict[str, Any]] = []
        self.events: list[str] = []
        self.fault: Any = None
        self.last = ""
        self.report: dict[str, Any] = {}
        self.num_steps = 0
        self.delay_s = 0.0
        self._training = training
        self._hello = hello or {}
        self._wanted: list[dict[str, Any]] = []
        self._news = threading.Condition()
        self.socket = socket.create_connection(("127.0.0.1", port), DEADLINE_S)
        self._talk = Talk(self.socket, spec or small_spec())
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    # --- what tests do --------------------------------------------------------------------------

    def ask(self, *kinds: str, **parts: Any) -> None:
        """Ask for something; ``parts`` belong to the only kind."""
        with self._news:
            self._wanted += [{"kind": kind, **parts} for kind in kinds]

    def await_status(self, what: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """Wait for a status that came after all that the test has seen so far; returns it."""
        with self._news:
            seen = 0

            def has_come() -> bool:
                nonlocal seen
                while seen < len(self.statuses):
                    if what(self.statuses[seen]):
                        return True
                    seen += 1
                return not self._thread.is_alive()

            self._news.wait_for(has_come, DEADLINE_S)
            assert seen < len(self.statuses), (self.statuses[-3:], self.last, self.report)
            found = self.statuses[seen]
            del self.statuses[: seen + 1]
            return found

    def await_state(self, state: str) -> dict[str, Any]:
        return self.await_status(lambda status: status["state"] == state)

    def await_message(self, text: str) -> dict[str, Any]:
        return self.await_status(lambda status: text in status["message"])

    def await_updates(self, num: int) -> dict[str, Any]:
        return self.await_status(lambda status: status["updates"] >= num)

    def await_the_end(self) -> None:
        self._thread.join(DEADLINE_S)
        assert not self._thread.is_alive(), "the server has not ended the conversation"

    def hang_up(self) -> None:
        """Go without a word, as a process that is killed."""
        self.socket.shutdown(socket.SHUT_RDWR)
        self.await_the_end()

    # --- what the game does ---------------------------------------------------------------------

    def _run(self) -> None:
        try:
            self._greet()
            while self._answer(*self._talk.read()):
                pass
        finally:
            self._talk.close()
            with self._news:
                self._news.notify_all()

    def _greet(self) -> None:
        hello = {**HELLO, "capabilities": CAPABILITIES, **self._hello}
        if self._training is not None:
            hello["training"] = self._training
        self._talk.json("HELLO", hello)
        name, payload = self._talk.read()
        if name == "CHALLENGE":
            self._talk.answer(hello, name, payload, user_token())
            name, payload = self._talk.read()
        if name == "WELCOME":
            self._talk.welcome = json.loads(payload)
            self._talk.json("SPEC", self._talk.spec)
        else:
            self._note_end(name, payload)

    @property
    def welcome(self) -> dict[str, Any]:
        return self._talk.welcome

    def _answer(self, name: str, payload: bytes) -> bool:
        if name not in {"RESET", "STEP", "CALL"}:
            if not self.last:
                self._note_end(name, payload)
            return False
        if name == "CALL":
            call = json.loads(payload)
            self._talk.json("RESULT", {"id": call["id"], "value": self._call(call)})
            return True
        self._note(name)
        self.num_steps = 0 if name == "RESET" else self.num_steps + 1
        self._send_batch(is_reset=name == "RESET")
        return True

    def _call(self, call: dict[str, Any]) -> Any:
        assert call["target"] == {"bridge": True}
        if call["method"] == "take_requests":
            with self._news:
                wanted, self._wanted = self._wanted, []
            return wanted
        if call["method"] == "show_status":
            (status,) = call["arguments"]
            self._note(status["state"])
            with self._news:
                self.statuses.append(status)
                self._news.notify_all()
            return None
        assert call["method"] == "stand_by"
        self._note("stand_by")
        return None

    def _send_batch(self, *, is_reset: bool) -> None:
        time.sleep(self.delay_s)
        change: Any = self.fault or {}
        if isinstance(change, bytes):
            self._talk.raw(change)
            return
        (policy,) = self._talk.spec["policies"]
        num = policy["num_agents"]
        size = policy["observation"][0]["shape"][0]
        has_ended = not is_reset and self.num_steps % EPISODE_STEPS == 0
        observation = {"observation": [[0.1 * self.num_steps % 1.0] * size] * num}
        content: dict[str, Any] = {
            "observation": observation,
            "reward": [0.0 if is_reset else 1.0] * num,
            "terminated": [int(has_ended)] * num,
            "truncated": [0] * num,
            "active": [1] * num,
            "final": {
                "slots": list(range(num)) if has_ended else [],
                "observation": observation if has_ended else {"observation": []},
            },
            **change,
        }
        with self._news:
            has_requests = bool(self._wanted)
        policies = {policy["name"]: content}
        self._talk.batch(is_reset=is_reset, has_requests=has_requests, policies=policies)

    def _note(self, event: str) -> None:
        if not self.events or self.events[-1] != event:
            self.events.append(event)

    def _note_end(self, name: str, payload: bytes) -> None:
        self.last = name
        if name == "ERROR":
            self.report = json.loads(payload)
