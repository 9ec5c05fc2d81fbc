"""What the game asks through a session, and what is told to it (PROTOCOL.md §8)."""

from __future__ import annotations

import contextlib
import json
import random
from typing import Any

import pytest

from ludus.errors import EngineError, GameError, ProtocolError, SequenceError, UsageError
from tests.fake_engine import HELLO, FakeEngine, Talk
from tests.session.conftest import Behaviour, Opener, answering, assert_ended, reset, step, zeros
from tests.wire.golden import load
from tests.wire.reference import frame, json_frame
from tests.wire.test_fuzz import ODD_VALUES, places, put

GOLDEN = load("result_requests").content["value"]
STATUS = load("call_show_status").content["arguments"][0]
NUM_MUTATIONS = 100


def result(value: Any, number: int = 1) -> bytes:
    return json_frame("RESULT", {"id": number, "value": value})


def old_engine(*answers: bytes | dict[str, Any]) -> Behaviour:
    """Like :func:`answering`, without the capability."""

    def behave(talk: Talk) -> None:
        talk.greet({**HELLO, "capabilities": ["call"]})
        for answer in answers:
            talk.read()
            talk.raw(answer if isinstance(answer, bytes) else talk.batch_frame(**answer))
        talk.wait_for_the_end()

    return behave


def calls(engine: FakeEngine) -> list[dict[str, Any]]:
    return [json.loads(payload) for name, payload in engine.talk.received if name == "CALL"]


def test_requests_are_taken_once(open_with: Opener) -> None:
    session = open_with(answering({}, {"has_requests": True}, result(GOLDEN), {}))
    reset(session)
    assert not session.has_requests
    assert session.take_requests() == []
    step(session)
    assert session.has_requests
    assert session.take_requests() == GOLDEN
    assert not session.has_requests
    assert session.take_requests() == []
    step(session)
    assert session.take_requests() == []
    session.close()
    open_with.engines[0].join()
    (asked,) = calls(open_with.engines[0])
    expected = load("call_take_requests").content
    assert {**asked, "id": expected["id"]} == expected


def test_requests_in_the_answer_to_a_reset(open_with: Opener) -> None:
    session = open_with(answering({"is_reset": True, "has_requests": True}, result(GOLDEN)))
    reset(session)
    assert session.take_requests() == GOLDEN


def test_requests_and_status_leave_the_last_batch_unchanged(open_with: Opener) -> None:
    session = open_with(answering({"has_requests": True}, result(GOLDEN), result(None, 2)))
    batch = reset(session)["cart"]
    seen = {name: values.copy() for name, values in batch.observation.items()}
    session.take_requests()
    session.show_status(STATUS)
    assert all((batch.observation[name] == values).all() for name, values in seen.items())


def test_an_engine_without_the_capability_is_not_asked(open_with: Opener) -> None:
    session = open_with(old_engine({"has_requests": True}, {}))
    reset(session)
    assert not session.has_requests
    assert session.take_requests() == []
    session.show_status(STATUS)
    step(session)
    session.close()
    open_with.engines[0].join()
    assert calls(open_with.engines[0]) == []


def test_a_status_is_shown(open_with: Opener) -> None:
    session = open_with(answering({}, result(None), {}))
    reset(session)
    session.show_status(STATUS)
    step(session)
    session.close()
    open_with.engines[0].join()
    (told,) = calls(open_with.engines[0])
    expected = load("call_show_status").content
    assert {**told, "id": expected["id"]} == expected


@pytest.mark.parametrize("status", [{"mean_return": float("nan")}, {"policies": {1, 2}}])
def test_a_status_must_be_json(open_with: Opener, status: dict[str, Any]) -> None:
    session = open_with(answering({}, {}))
    reset(session)
    with pytest.raises(UsageError, match="arguments of show_status must be JSON"):
        session.show_status(status)
    step(session)


def test_requests_and_status_during_a_step_are_refused(open_with: Opener) -> None:
    asking = {"has_requests": True}
    session = open_with(answering(asking, asking, result(GOLDEN, 3)))
    reset(session)
    session.send(zeros(session))
    for disturb in (session.take_requests, lambda: session.show_status(STATUS)):
        with pytest.raises(SequenceError, match="CALL is not allowed in STEPPING"):
            disturb()
    session.receive()
    assert session.take_requests() == GOLDEN


def test_a_refused_call_leaves_the_session_usable(open_with: Opener) -> None:
    refusal = json_frame("RESULT", {"id": 1, "error": "no"})
    session = open_with(answering({"has_requests": True}, refusal, {}))
    reset(session)
    with pytest.raises(GameError, match="call of take_requests failed: no"):
        session.take_requests()
    step(session)


@pytest.mark.parametrize("value", [None, 7, {"kind": "save"}, [7], [{"kind": "Save"}]])
def test_an_answer_that_is_not_a_list_of_requests_is_refused(open_with: Opener, value: Any) -> None:
    session = open_with(answering({"has_requests": True}, result(value)))
    reset(session)
    with pytest.raises(ProtocolError, match=r"take_requests\(\)"):
        session.take_requests()
    assert_ended(session)
    open_with.engines[0].join()
    last, payload = open_with.engines[0].talk.received[-1]
    assert last == "ERROR"
    assert b'"code":"frame"' in payload


def odd_answers() -> list[bytes]:
    """Answers in which one value, or a few bytes, are wrong."""
    message = {"id": 1, "value": GOLDEN}
    answers = [
        json.dumps(put(message, path, odd)).replace("Infinity", "1e999").encode()
        for path in places(message)
        for odd in ODD_VALUES
    ]
    chance = random.Random(0)
    for _ in range(NUM_MUTATIONS):
        text = bytearray(json.dumps(message).encode())
        for _ in range(chance.randint(1, 4)):
            text[chance.randrange(len(text))] = chance.randrange(256)
        answers.append(bytes(text))
    return answers


@pytest.mark.slow
def test_odd_answers_raise_only_documented_errors(open_with: Opener) -> None:
    """One engine sees to as many answers as it can; an error ends it."""
    answers = odd_answers()
    num_refused = 0
    while answers:
        session = open_with(feeding(answers))
        with contextlib.suppress(EngineError):
            while answers:
                reset(session)
                requests = session.take_requests()
                assert all(isinstance(request["kind"], str) for request in requests)
            continue
        num_refused += 1
    assert num_refused > NUM_MUTATIONS


def feeding(answers: list[bytes]) -> Behaviour:
    """An engine whose game always has requests, and whose answers are these, one by one."""

    def behave(talk: Talk) -> None:
        talk.greet()
        call = 0
        while (name := talk.read()[0]) in {"RESET", "CALL"}:
            if name == "RESET":
                talk.batch(is_reset=True, has_requests=True)
                continue
            call += 1
            talk.raw(frame("RESULT", answers.pop().replace(b'"id": 1', b'"id": %d' % call, 1)))

    return behave
