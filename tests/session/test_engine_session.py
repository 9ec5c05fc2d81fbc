"""A conversation with an engine that keeps the rules, and with many that break them."""

from __future__ import annotations

import struct
import time
from typing import Any

import numpy as np
import pytest

from ludus.errors import (
    ActionError,
    EngineCrashed,
    EngineTimeout,
    GameError,
    ProtocolError,
    SequenceError,
    UsageError,
)
from ludus.spec.batch import ActionBatch
from ludus.wire.reset import ResetRequest
from tests.fake_engine import FLAT, HELLO, POLICIES, Talk
from tests.session.conftest import (
    Opener,
    answering,
    assert_ended,
    obedient,
    reset,
    step,
    zeros,
)
from tests.wire.reference import decode_reset, decode_step, encode_batch, frame, quiet_batch

# An engine that keeps the rules


def test_frames_are_exchanged_in_the_order_of_the_protocol(open_with: Opener) -> None:
    session = open_with(obedient)
    assert session.spec.num_worlds == 3
    assert session.hello.engine == "godot 4.6.3"
    assert session.pid is None
    first = reset(session)["cart"]
    assert first.observation["observation"].tolist() == [[0.0] * 5] * 3
    for number in (1, 2, 3):
        batch = step(session)["cart"]
        assert batch.observation["observation"].tolist() == [[float(number)] * 5] * 3
    session.close()
    open_with.engines[0].join()
    names = [name for name, _ in open_with.engines[0].talk.received]
    assert names == ["CHALLENGE", "WELCOME", "RESET", "STEP", "STEP", "STEP", "CLOSE"]


def test_seeds_parameters_and_actions_reach_the_engine(open_with: Opener) -> None:
    session = open_with(obedient, POLICIES)
    session.reset(ResetRequest.all_worlds(2, 2**64 - 1, [{"a": 1}, None]))
    actions = zeros(session)
    actions["hero"].discrete[:] = [[3], [1]]
    actions["hero"].continuous[1] = [0.25, -0.5, 1.0]
    session.send(actions)
    session.receive()
    received = dict(open_with.engines[0].talk.received)
    assert decode_reset(received["RESET"]) == {
        "seeds": ["ffffffffffffffff", "0000000000000000"],
        "actions": [2, 2],
        "parameters": [{"a": 1}, None],
    }
    hero = decode_step(POLICIES, received["STEP"])["policies"]["hero"]
    assert hero == {"discrete": [[3], [1]], "continuous": [[0.0] * 3, [0.25, -0.5, 1.0]]}


def test_frames_that_arrive_byte_by_byte_are_read(open_with: Opener) -> None:
    def drip(talk: Talk) -> None:
        raw = talk.raw

        def drip_raw(data: bytes) -> None:
            for i in range(len(data)):
                raw(data[i : i + 1])

        talk.raw = drip_raw  # type: ignore[method-assign]
        obedient(talk)

    session = open_with(drip)
    reset(session)
    assert step(session)["cart"].observation["observation"][2, 4] == 1.0


def test_times_are_those_of_the_last_step(open_with: Opener) -> None:
    session = open_with(answering({"tick": 77, "engine_us": 1, "bridge_us": 2, "wait_us": 3}))
    reset(session)
    times = session.times
    assert (times.tick, times.engine_us, times.bridge_us, times.wait_us) == (77, 1, 2, 3)


def test_a_call_returns_its_value_or_raises_the_error_of_the_game(open_with: Opener) -> None:
    answers = [b'{"id": 1, "value": [2.5]}', b'{"id": 2.0, "error": "no such wind"}', b'{"id": 3}']
    session = open_with(answering(*[frame("RESULT", answer) for answer in answers]))
    assert session.call({"world": 0}, "get_wind", [1]) == [2.5]
    with pytest.raises(GameError, match="call of set_wind failed: no such wind"):
        session.call({"world": 0}, "set_wind")
    assert session.call({"world": 0}, "get_nothing") is None


def test_arguments_of_a_call_must_be_json(open_with: Opener) -> None:
    session = open_with(obedient)
    with pytest.raises(UsageError, match="arguments of set_wind must be JSON"):
        session.call({"world": 0}, "set_wind", [object()])
    reset(session)


def test_the_result_of_another_call_is_refused(open_with: Opener) -> None:
    session = open_with(answering(frame("RESULT", b'{"id": 9, "value": 1}')))
    with pytest.raises(ProtocolError, match="RESULT of call 9, expected 1"):
        session.call({"world": 0}, "get_wind")
    assert_ended(session)


def test_close_may_be_called_twice(open_with: Opener) -> None:
    session = open_with(obedient)
    session.close()
    session.close()
    assert_ended(session)


# A caller that breaks the rules


def test_step_before_reset_is_refused(open_with: Opener) -> None:
    session = open_with(obedient)
    with pytest.raises(SequenceError, match="step before the first reset"):
        session.send(zeros(session))
    reset(session)
    step(session)


def test_receive_without_send_is_refused(open_with: Opener) -> None:
    session = open_with(obedient)
    for prepare in (lambda: None, lambda: reset(session)):
        prepare()
        with pytest.raises(SequenceError, match="nothing to receive"):
            session.receive()


def test_a_second_send_is_refused(open_with: Opener) -> None:
    session = open_with(obedient)
    reset(session)
    session.send(zeros(session))
    with pytest.raises(SequenceError, match=r"(?s)STEP is not allowed.*receive the answer"):
        session.send(zeros(session))
    session.receive()


def test_a_reset_of_too_few_worlds_is_refused(open_with: Opener) -> None:
    session = open_with(obedient)
    with pytest.raises(UsageError, match="reset of 2 worlds, the engine has 3"):
        session.reset(ResetRequest.all_worlds(2, 0))


def test_wrong_actions_leave_the_session_usable(open_with: Opener) -> None:
    session = open_with(obedient)
    reset(session)
    with pytest.raises(ActionError):
        session.send(
            {"cart": ActionBatch(np.zeros((1, 1), np.int64), np.zeros((3, 0), np.float32))}
        )
    step(session)


# An engine that breaks off, or breaks the rules, in the middle


@pytest.mark.slow
def test_a_silent_engine_times_out(open_with: Opener) -> None:
    session = open_with(answering({}), step_timeout_s=1.0)
    reset(session)
    began = time.monotonic()
    with pytest.raises(EngineTimeout, match="silent for 1 s"):
        step(session)
    assert time.monotonic() - began < 5.0
    assert_ended(session)


@pytest.mark.parametrize("num_bytes", [0, 4, 8, 50])
def test_a_connection_that_ends_within_a_frame_is_a_crash(
    open_with: Opener, num_bytes: int
) -> None:
    def behave(talk: Talk) -> None:
        talk.greet()
        talk.read()
        talk.raw(talk.batch_frame()[:num_bytes])

    session = open_with(behave)
    with pytest.raises(EngineCrashed, match="connection to the engine ended"):
        reset(session)
    assert_ended(session)


def test_an_engine_that_closes_is_a_crash(open_with: Opener) -> None:
    session = open_with(answering({}, frame("CLOSE", b"")))
    reset(session)
    with pytest.raises(EngineCrashed, match="closed the connection"):
        step(session)
    assert_ended(session)


def flat_payload() -> bytes:
    return encode_batch(FLAT, quiet_batch(FLAT))


@pytest.mark.parametrize(
    ("answer", "what"),
    [
        (frame("BATCH", b""), "BATCH has 0 bytes"),
        (frame("BATCH", flat_payload()[:-8]), "BATCH has"),
        (frame("BATCH", flat_payload() + bytes(8)), "BATCH has 8 bytes too many"),
        (frame("BATCH", flat_payload() + bytes(4096)), "expected at most"),
        (struct.pack("<IBBH", 2**32 - 1, 6, 0, 0), "the limit is"),
        (frame("SPEC", b"{}"), "the engine sent SPEC in STEPPING"),
        (frame("HELLO", b"{}"), "the engine sent HELLO in STEPPING"),
        (frame("PONG", b"x" * 10_000), "the engine sent PONG in STEPPING"),
        (frame("RESULT", b"{}"), "the engine sent RESULT in STEPPING"),
        (frame("STEP", flat_payload()), "the engine sent STEP in STEPPING"),
        (b"\xff" * 8, "unknown type 255"),
    ],
)
def test_a_wrong_answer_is_named_and_reported_to_the_engine(
    open_with: Opener, answer: bytes, what: str
) -> None:
    session = open_with(answering({}, answer))
    reset(session)
    with pytest.raises(ProtocolError, match=what):
        step(session)
    assert_ended(session)
    open_with.engines[0].join()
    last, payload = open_with.engines[0].talk.received[-1]
    assert last == "ERROR"
    assert b'"code":"frame"' in payload


def test_an_unexpected_batch_is_refused(open_with: Opener) -> None:
    twice = frame("BATCH", flat_payload()) * 2
    session = open_with(answering(twice))
    reset(session)
    with pytest.raises(ProtocolError, match="the engine sent BATCH in READY"):
        session.send(zeros(session))
    assert_ended(session)


def test_an_error_between_steps_is_raised_by_the_next_send(open_with: Opener) -> None:
    report = b'{"code": "game", "message": "out of ammunition"}'
    session = open_with(answering(frame("BATCH", flat_payload()) + frame("ERROR", report)))
    reset(session)
    with pytest.raises(GameError, match="out of ammunition"):
        session.send(zeros(session))
    assert_ended(session)


# Numbers that are none


def batch_with(policy: str, **parts: Any) -> dict[str, Any]:
    policies = quiet_batch(POLICIES)["policies"]
    policies[policy] |= parts
    return {"policies": policies}


NAN, INF = float("nan"), float("inf")
AIM = {"aim": [[0.0] * 3, [0.0, NAN, 0.0]], "health": [[1], [1]]}
PLACE = {"place": [[[0.0], [0.0]]] * 4 + [[[0.0], [-INF]]] + [[[0.0], [0.0]]]}
FINAL = {"slots": [4], "observation": {"place": [[[INF], [0.0]]]}}


@pytest.mark.parametrize(
    ("content", "what"),
    [
        (
            batch_with("hero", observation=AIM),
            'hero: world 1, agent Hero/LudusAgent: observation["aim"][1] is nan at step 2',
        ),
        (
            batch_with("hero", reward=[INF, 0.0]),
            "hero: world 0, agent Hero/LudusAgent: reward is inf at step 2",
        ),
        (
            batch_with("Ziel ✓", observation=PLACE),
            "Ziel ✓: world 1, agent Targets/B/LudusAgent: "
            'observation["place"][1][0] is -inf at step 2',
        ),
        (
            batch_with("Ziel ✓", reward=[0.0, 0.0, NAN, 0.0, 0.0, 0.0]),
            "Ziel ✓: world 0, agent (joined later): reward is nan at step 2",
        ),
        (
            batch_with("Ziel ✓", final=FINAL),
            "Ziel ✓: world 1, agent Targets/B/LudusAgent: "
            'final observation["place"][0][0] is inf at step 2',
        ),
    ],
)
def test_nan_and_infinity_are_named_with_their_place(
    open_with: Opener, content: dict[str, Any], what: str
) -> None:
    def behave(talk: Talk) -> None:
        talk.greet()
        talk.read()
        talk.batch(is_reset=True)
        talk.read()
        talk.batch()
        talk.read()
        talk.batch(**content)
        talk.wait_for_the_end()

    session = open_with(behave, POLICIES)
    reset(session)
    step(session)
    with pytest.raises(GameError) as caught:
        step(session)
    assert caught.value.message == what
    assert "division by zero" in caught.value.hint
    assert_ended(session)


def test_huge_numbers_are_finite(open_with: Opener) -> None:
    huge = [[3.4e38] * 3, [-3.4e38] * 3]
    observation = {"aim": huge, "health": [[1], [1]]}
    session = open_with(answering(batch_with("hero", observation=observation)), POLICIES)
    assert reset(session)["hero"].observation["aim"][1, 2] < -3e38


def test_what_an_engine_cannot_do_is_not_asked_of_it(open_with: Opener) -> None:
    def behave(talk: Talk) -> None:
        talk.greet({**HELLO, "capabilities": []})
        talk.serve()

    session = open_with(behave)
    with pytest.raises(UsageError, match="cannot call get_wind: it lacks the capability call"):
        session.call({"world": 0}, "get_wind")
    with pytest.raises(UsageError, match="lacks the capability ceiling"):
        session.call({"bridge": True}, "run_ceiling", [1, 0])
    some = ResetRequest(np.zeros(3, np.uint64), np.array([0, 1, 2], np.uint8))
    with pytest.raises(UsageError, match="cannot reset some of its worlds"):
        session.reset(some)
    reset(session)
    step(session)
