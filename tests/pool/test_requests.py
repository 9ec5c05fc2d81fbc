"""What games ask of the trainer through a pool, and what is told to them (PROTOCOL.md §8)."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from ludus.errors import EngineCrashed, EngineTimeout, GameError, SequenceError, UsageError
from ludus.pool import EnginePool, Pool
from ludus.session.engine_session import EngineSession
from ludus.session.supervision import Supervision
from ludus.spec.batch import ActionBatch
from ludus.wire.handshake import EngineConfig
from tests.actions import zeros
from tests.fake_engine import FLAT, HELLO, FakeEngine, Talk, end_all
from tests.wire.golden import load

SAVE = {"kind": "save"}
STOP = {"kind": "stop"}
FREEZE = {"kind": "set_mode", "policy": "cart", "mode": "frozen"}
TRAIN = {**FREEZE, "mode": "train"}
STATUS = load("call_show_status").content["arguments"][0]


class Games:
    """Starts fake engines whose games ask for things.

    Attributes:
        waiting: Engine → the requests that its game has, in its first life.
        deaths: Engine → the call at which it goes, in its first life.
        frozen: Those of ``deaths`` that freeze rather than end.
        old: Engines without the capability.
        statuses: Engine → what it was told, in all of its lives.
    """

    def __init__(self) -> None:
        self.waiting: dict[int, list[dict[str, Any]]] = {}
        self.deaths: dict[int, str] = {}
        self.frozen: set[int] = set()
        self.old: set[int] = set()
        self.statuses: dict[int, list[Any]] = {}
        self.num_starts: dict[int, int] = {}
        self.engines: list[FakeEngine] = []
        self.sessions: list[EngineSession] = []

    def open(self, engine: int) -> EngineSession:
        life = self.num_starts.get(engine, 0)
        self.num_starts[engine] = life + 1
        fake = FakeEngine(lambda talk: self._play(talk, engine, life))
        self.engines.append(fake)
        timeout_s = 1.0 if engine in self.frozen else 5.0
        supervision = Supervision(None)
        session = EngineSession(
            fake.link(), EngineConfig(), supervision, fake.greeting(), timeout_s
        )
        self.sessions.append(session)
        return session

    def _play(self, talk: Talk, engine: int, life: int) -> None:
        talk.greet({**HELLO, "capabilities": ["call"]} if engine in self.old else HELLO)
        waiting = self.waiting.get(engine, []) if life == 0 else []
        while (frame := talk.read())[0] in {"RESET", "STEP", "CALL"}:
            if frame[0] != "CALL":
                talk.batch(is_reset=frame[0] == "RESET", has_requests=bool(waiting))
                continue
            call = json.loads(frame[1])
            if life == 0 and self.deaths.get(engine) == call["method"]:
                if engine in self.frozen:
                    talk.wait_for_the_end()
                return
            talk.json("RESULT", {"id": call["id"], "value": self._answer(engine, call, waiting)})

    def _answer(self, engine: int, call: dict[str, Any], waiting: list[dict[str, Any]]) -> Any:
        assert call["target"] == {"bridge": True}
        if call["method"] == "take_requests":
            taken = waiting.copy()
            waiting.clear()
            return taken
        assert call["method"] == "show_status"
        self.statuses.setdefault(engine, []).extend(call["arguments"])
        return None

    def end(self) -> None:
        end_all(self.sessions, self.engines)


@pytest.fixture
def games() -> Iterator[Games]:
    made = Games()
    yield made
    made.end()


def own_zeros(pool: EnginePool) -> dict[str, ActionBatch]:
    return {name: ActionBatch.zeros(own, own.num_agents) for name, own in pool.policies.items()}


def take(pool: Pool) -> list[dict[str, Any]]:
    return pool.take_requests()


def show(pool: Pool) -> None:
    pool.show_status(STATUS)


CALLS: dict[str, Callable[[Pool], object]] = {"take_requests": take, "show_status": show}


def test_requests_of_all_engines(games: Games) -> None:
    games.waiting = {0: [FREEZE, SAVE], 2: [STOP]}
    pool = EnginePool(games.open, 3)
    assert pool.take_requests() == []
    pool.reset(1)
    assert pool.take_requests() == [FREEZE, SAVE, STOP]
    assert pool.take_requests() == []
    pool.step(zeros(pool))
    assert pool.take_requests() == []


def test_requests_that_come_later(games: Games) -> None:
    games.waiting = {0: [], 1: []}
    pool = EnginePool(games.open, 2)
    pool.reset(1)
    games.waiting[1].append(SAVE)
    assert pool.take_requests() == [], "no answer has told of it yet"
    pool.step(zeros(pool))
    assert pool.take_requests() == [SAVE]


def test_equal_requests_of_several_engines_count_once(games: Games) -> None:
    games.waiting = {0: [FREEZE, SAVE, TRAIN], 1: [SAVE, STOP], 2: [FREEZE, FREEZE]}
    pool = EnginePool(games.open, 3)
    pool.reset(1)
    assert pool.take_requests() == [FREEZE, SAVE, TRAIN, STOP]


def test_a_game_may_ask_for_the_same_again(games: Games) -> None:
    games.waiting = {0: [FREEZE, SAVE, FREEZE]}
    pool = EnginePool(games.open, 1)
    pool.reset(1)
    assert pool.take_requests() == [FREEZE, SAVE, FREEZE]


def test_a_status_reaches_all_engines(games: Games) -> None:
    games.old = {1}
    pool = EnginePool(games.open, 3)
    pool.show_status(STATUS)
    pool.reset(1)
    pool.show_status({**STATUS, "updates": 99})
    expected = [STATUS, {**STATUS, "updates": 99}]
    assert games.statuses == {0: expected, 2: expected}


def test_a_status_that_is_not_json_ends_nothing(games: Games) -> None:
    pool = EnginePool(games.open, 2)
    pool.reset(1)
    with pytest.raises(UsageError, match="must be JSON"):
        pool.show_status({"mean_return": float("nan")})
    pool.step(zeros(pool))


def test_an_old_engine_is_not_asked(games: Games) -> None:
    games.old = {0}
    games.waiting = {0: [SAVE], 1: [STOP]}
    pool = EnginePool(games.open, 2)
    pool.reset(1)
    assert pool.take_requests() == [STOP]
    assert games.waiting[0] == [SAVE]


@pytest.mark.parametrize("method", CALLS)
def test_a_step_is_not_disturbed(games: Games, method: str) -> None:
    games.waiting = {0: [SAVE], 1: [STOP]}
    pool = EnginePool(games.open, 2)
    pool.reset(1)
    pool.send(1, own_zeros(pool))
    with pytest.raises(SequenceError, match=f"{method} while engine 1 is in a step"):
        CALLS[method](pool)
    assert games.waiting == {0: [SAVE], 1: [STOP]}
    assert games.statuses == {}
    pool.receive(1)
    assert pool.take_requests() == [SAVE, STOP]


@pytest.mark.slow
@pytest.mark.parametrize("is_frozen", [False, True], ids=["crashed", "frozen"])
@pytest.mark.parametrize("method", CALLS)
def test_an_engine_that_goes_meanwhile_is_started_again(
    games: Games, method: str, is_frozen: bool, caplog: pytest.LogCaptureFixture
) -> None:
    games.waiting = {0: [FREEZE], 1: [SAVE], 2: [STOP]}
    games.deaths = {1: method}
    games.frozen = {1} if is_frozen else set()
    pool = EnginePool(games.open, 3, max_restarts=1)
    pool.reset(1)
    with caplog.at_level(logging.WARNING):
        CALLS[method](pool)
    assert "engine 1 is started again (1 of 1)" in caplog.text
    assert pool.num_restarts == 1
    # The one that is lost is left alone until its next step, whose worlds are then truncated.
    CALLS[method](pool)
    batch = pool.step(zeros(pool))["cart"]
    assert batch.truncated.tolist() == [False] * 3 + [True] * 3 + [False] * 3
    assert not pool.step(zeros(pool))["cart"].truncated.any()
    CALLS[method](pool)
    if method == "take_requests":
        assert pool.take_requests() == []
    else:
        assert games.statuses == {0: [STATUS] * 3, 1: [STATUS], 2: [STATUS] * 3}
        assert pool.take_requests() == [FREEZE, STOP], "those of a lost engine are lost with it"
    assert games.num_starts == {0: 1, 1: 2, 2: 1}


def test_what_others_have_asked_is_not_lost_with_an_engine(games: Games) -> None:
    games.waiting = {0: [FREEZE], 1: [SAVE], 2: [STOP]}
    games.deaths = {1: "take_requests"}
    pool = EnginePool(games.open, 3, max_restarts=1)
    pool.reset(1)
    assert pool.take_requests() == [FREEZE, STOP]


@pytest.mark.parametrize("method", CALLS)
def test_a_reset_revives_an_engine_that_went_meanwhile(games: Games, method: str) -> None:
    games.waiting = {0: [SAVE]}
    games.deaths = {0: method}
    pool = EnginePool(games.open, 1, max_restarts=1)
    pool.reset(1)
    CALLS[method](pool)
    with pytest.raises(SequenceError, match="nothing to receive"):
        pool.receive(0)
    assert not pool.reset(2)["cart"].truncated.any()
    assert not pool.step(zeros(pool))["cart"].truncated.any()


def test_a_reset_forgets_a_step_that_was_sent_to_a_lost_engine(games: Games) -> None:
    games.deaths = {0: "show_status"}
    pool = EnginePool(games.open, 1, max_restarts=1)
    pool.reset(1)
    pool.show_status(STATUS)
    pool.send(0, own_zeros(pool))
    pool.reset(2)
    assert not pool.step(zeros(pool))["cart"].truncated.any()


@pytest.mark.slow
@pytest.mark.parametrize(("is_frozen", "kind"), [(False, EngineCrashed), (True, EngineTimeout)])
@pytest.mark.parametrize("method", CALLS)
def test_without_restarts_an_error_ends_all(
    games: Games, method: str, is_frozen: bool, kind: type[Exception]
) -> None:
    games.waiting = {1: [SAVE]}
    games.deaths = {1: method}
    games.frozen = {1} if is_frozen else set()
    pool = EnginePool(games.open, 2)
    pool.reset(1)
    with pytest.raises(kind):
        CALLS[method](pool)
    for engine in games.engines:
        engine.join()


def test_a_mistake_in_an_answer_is_not_forgiven(games: Games) -> None:
    def behave(talk: Talk) -> None:
        talk.greet()
        talk.read()
        talk.batch(is_reset=True, has_requests=True)
        talk.read()
        talk.json("RESULT", {"id": 1, "error": "no"})
        talk.wait_for_the_end()

    fake = FakeEngine(behave, FLAT)
    games.engines.append(fake)
    session = EngineSession(fake.link(), EngineConfig(), Supervision(None), fake.greeting())
    games.sessions.append(session)
    pool = EnginePool(lambda _: session, 1, 9)
    pool.reset(1)
    with pytest.raises(GameError, match="take_requests failed"):
        pool.take_requests()
    assert pool.num_restarts == 0


def test_actions_are_sent_once_for_each_answer(games: Games) -> None:
    pool = EnginePool(games.open, 2)
    pool.reset(1)
    pool.send(0, own_zeros(pool))
    with pytest.raises(SequenceError, match="engine 0 was sent actions twice"):
        pool.send(0, own_zeros(pool))
    pool.receive(0)
    with pytest.raises(SequenceError, match="nothing to receive"):
        pool.receive(0)


def test_gymnasium_environments_ask_nothing() -> None:
    from ludus.pool import open_pool

    pool: Pool = open_pool("gym:CartPole-v1")
    pool.reset(1)
    assert pool.take_requests() == []
    pool.show_status(STATUS)
    pool.close()
