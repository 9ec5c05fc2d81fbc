"""Greeting an engine: what fits, and what is refused."""

from __future__ import annotations

import json
import struct
import time

import pytest

from ludus.errors import (
    EngineStartError,
    GameError,
    LudusError,
    ProtocolError,
    TargetError,
)
from tests.fake_engine import HELLO, TOKEN, Talk
from tests.session.conftest import (
    Opener,
    answering,
    assert_ended,
    obedient,
    reset,
)
from tests.wire.reference import frame


@pytest.mark.parametrize(
    ("code", "kind"),
    [
        ("version", EngineStartError),
        ("token", EngineStartError),
        ("config", TargetError),
        ("game", GameError),
        ("sequence", ProtocolError),
        ("frame", ProtocolError),
        ("timeout", ProtocolError),
        ("internal", ProtocolError),
        ("poetry", ProtocolError),
    ],
)
@pytest.mark.parametrize("when", ["greeting", "step"])
def test_an_error_frame_raises_the_error_of_its_code(
    open_with: Opener, code: str, kind: type[LudusError], when: str
) -> None:
    report = {"code": code, "message": "the reason " + "x" * 5000, "hint": "the advice"}

    def behave(talk: Talk) -> None:
        if when == "step":
            talk.greet()
        else:
            talk.json("HELLO", HELLO)
        talk.read()
        talk.json("ERROR", report)
        talk.wait_for_the_end()

    with pytest.raises(LudusError) as caught:
        reset(open_with(behave))
    assert type(caught.value) is kind
    assert caught.value.message == report["message"]
    assert caught.value.hint == "the advice"


@pytest.mark.parametrize("payload", [b"", b"no json", b"[]", b"\xff"])
def test_a_malformed_error_ends_the_session(open_with: Opener, payload: bytes) -> None:
    session = open_with(answering(frame("ERROR", payload)))
    with pytest.raises(ProtocolError, match="ERROR"):
        reset(session)
    assert_ended(session)


@pytest.mark.parametrize(
    ("versions", "upgrade"),
    [
        ((0, 0), "ludus addon install"),
        ((1, 1), "ludus addon install"),
        ((3, 9), "pip install --upgrade"),
    ],
)
def test_without_a_common_version_both_sides_learn_which_to_upgrade(
    open_with: Opener, versions: tuple[int, int], upgrade: str
) -> None:
    def behave(talk: Talk) -> None:
        talk.json("HELLO", {**HELLO, "protocol": {"min": versions[0], "max": versions[1]}})
        name, payload = talk.read()
        assert name == "ERROR"
        assert b'"code":"version"' in payload
        assert b'"proof":"' in payload
        assert upgrade.encode() in payload

    with pytest.raises(EngineStartError) as caught:
        open_with(behave)
    assert upgrade in caught.value.hint


@pytest.mark.parametrize("token", ["", "another token of 16", "zwölf"])
def test_an_engine_with_another_token_is_refused_and_learns_nothing_of_ours(
    open_with: Opener, token: str
) -> None:
    def behave(talk: Talk) -> None:
        talk.json("HELLO", HELLO)
        talk.prove(token=token)
        name, payload = talk.read()
        assert name == "ERROR"
        assert b'"code":"token"' in payload

    with pytest.raises(EngineStartError, match="token is not ours"):
        open_with(behave)
    open_with.engines[0].join()
    assert all(TOKEN.encode() not in payload for _, payload in open_with.engines[0].talk.received)


def test_an_engine_that_reflects_our_proof_is_refused(open_with: Opener) -> None:
    def behave(talk: Talk) -> None:
        talk.json("HELLO", HELLO)
        challenge = json.loads(talk.read()[1])
        talk.json("PROOF", {"proof": challenge["proof"]})
        talk.wait_for_the_end()

    with pytest.raises(EngineStartError, match="token is not ours"):
        open_with(behave)


def test_an_engine_that_proves_itself_is_welcomed_without_a_token(open_with: Opener) -> None:
    reset(open_with(obedient))
    assert "token" not in open_with.engines[0].talk.welcome


@pytest.mark.parametrize(
    ("greeting", "what"),
    [
        (frame("SPEC", b"{}"), "the engine sent SPEC in CONNECTED"),
        (frame("BATCH", b""), "the engine sent BATCH in CONNECTED"),
        (frame("HELLO", b"[]"), "HELLO must be a JSON object"),
        (frame("HELLO", b"{}"), "HELLO.protocol: missing"),
        (b"GET / HTTP/1.1\r\n\r\n", "unknown type 47"),
        (struct.pack("<IBBH", 1 << 25, 1, 0, 0), "HELLO frame of 33554432 bytes, the limit is"),
        (frame("HELLO", b"{}")[:5] + b"\x01\x00\x00{}", "flags 1"),
    ],
)
def test_a_wrong_greeting_is_named(open_with: Opener, greeting: bytes, what: str) -> None:
    def behave(talk: Talk) -> None:
        talk.raw(greeting)
        talk.wait_for_the_end()

    with pytest.raises(ProtocolError, match=what):
        open_with(behave)
    open_with.engines[0].join()


def test_a_wrong_spec_is_named(open_with: Opener) -> None:
    def behave(talk: Talk) -> None:
        talk.spec = {**talk.spec, "num_worlds": 0}
        talk.greet()
        talk.wait_for_the_end()

    with pytest.raises(ProtocolError, match=r"spec\.num_worlds"):
        open_with(behave)


@pytest.mark.parametrize("when", ["before HELLO", "before SPEC"])
def test_an_engine_that_never_sends_its_spec_times_out(open_with: Opener, when: str) -> None:
    def behave(talk: Talk) -> None:
        if when == "before SPEC":
            talk.json("HELLO", HELLO)
        talk.wait_for_the_end()

    began = time.monotonic()
    with pytest.raises(EngineStartError, match=r"(?s)silent for 0\.3 s.*start_timeout_s"):
        open_with(behave, start_timeout_s=0.3)
    assert time.monotonic() - began < 5.0
    open_with.engines[0].join()
    assert b'"code":"timeout"' in open_with.engines[0].talk.received[-1][1]
