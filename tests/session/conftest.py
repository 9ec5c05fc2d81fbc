"""Opens sessions with fake engines, and ends both."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from ludus.errors import (
    SequenceError,
)
from ludus.session.engine_session import EngineSession
from ludus.session.supervision import Supervision
from ludus.spec.batch import ActionBatch
from ludus.wire.greeting import Greeting
from ludus.wire.handshake import EngineConfig
from ludus.wire.reset import ResetRequest
from tests.fake_engine import FLAT, TOKEN, FakeEngine, Talk, end_all

Behaviour = Callable[[Talk], None]


class Opener:
    """Opens sessions with fake engines, and ends both."""

    def __init__(self) -> None:
        self.engines: list[FakeEngine] = []
        self.sessions: list[EngineSession] = []

    def __call__(
        self,
        behaviour: Behaviour,
        spec: dict[str, Any] = FLAT,
        token: str = TOKEN,
        start_timeout_s: float = 5.0,
        step_timeout_s: float = 5.0,
    ) -> EngineSession:
        engine = FakeEngine(behaviour, spec)
        self.engines.append(engine)
        link = engine.link(start_timeout_s)
        config = EngineConfig(num_worlds=3)
        session = EngineSession(link, config, Supervision(None), Greeting(token), step_timeout_s)
        self.sessions.append(session)
        return session

    def end(self) -> None:
        end_all(self.sessions, self.engines)


@pytest.fixture
def open_with() -> Iterator[Opener]:
    opener = Opener()
    yield opener
    opener.end()


def obedient(talk: Talk) -> None:
    talk.greet()
    talk.serve()


def answering(*answers: bytes | dict[str, Any]) -> Behaviour:
    """An engine that answers its requests with these bytes, or batches with these changes."""

    def behave(talk: Talk) -> None:
        talk.greet()
        for answer in answers:
            talk.read()
            talk.raw(answer if isinstance(answer, bytes) else talk.batch_frame(**answer))
        talk.wait_for_the_end()

    return behave


def zeros(session: EngineSession) -> dict[str, ActionBatch]:
    return {
        name: ActionBatch.zeros(policy, policy.num_agents)
        for name, policy in session.policies.items()
    }


def reset(session: EngineSession) -> Any:
    return session.reset(ResetRequest.all_worlds(session.spec.num_worlds, 7))


def step(session: EngineSession) -> Any:
    session.send(zeros(session))
    return session.receive()


def assert_ended(session: EngineSession) -> None:
    with pytest.raises(SequenceError, match="the environment is closed"):
        reset(session)
