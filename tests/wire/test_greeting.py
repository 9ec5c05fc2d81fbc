"""The trainer's part of a greeting: who is taken for an engine, and who is not (PROTOCOL.md §3)."""

from __future__ import annotations

import contextlib
import json
import random
from typing import Any

import pytest

from ludus.errors import EngineStartError, ProtocolError
from ludus.wire.frames import FrameType, decode_json
from ludus.wire.greeting import Greeting
from ludus.wire.handshake import GreetingRefused
from ludus.wire.proof import is_hex, make_nonce, make_proof
from tests.wire.golden import load
from tests.wire.reference import make_proof as reference_proof
from tests.wire.stream import cut_frames
from tests.wire.test_fuzz import ODD_VALUES, places, put

HELLO = load("hello").content
OLD_HELLO = load("hello_protocol_1").content
TOKEN = "a token of 16 characters"
REPORT = {"code": "version", "message": "too old", "hint": "upgrade"}


def say(greeting: Greeting, frame_type: FrameType, content: Any) -> dict[str, Any]:
    """Send a frame as an engine; return the content of the answer, empty if there is none."""
    greeting.state.receive(frame_type)
    answer = greeting.answer(frame_type, json.dumps(content).encode())
    if answer is None:
        return {}
    ((answer_type, payload),) = cut_frames(answer)
    assert answer_type is FrameType.CHALLENGE
    return decode_json(payload, "CHALLENGE")


def test_both_sides_prove_that_they_know_the_token_and_neither_tells_it() -> None:
    greeting = Greeting(TOKEN)
    challenge = say(greeting, FrameType.HELLO, HELLO)
    nonces = HELLO["nonce"], challenge["nonce"]
    assert challenge == {
        "protocol": 2,
        "nonce": challenge["nonce"],
        "proof": reference_proof(TOKEN, "trainer", *nonces),
    }
    assert is_hex(challenge["nonce"])
    assert not greeting.is_over
    assert say(greeting, FrameType.PROOF, {"proof": make_proof(TOKEN, "engine", *nonces)}) == {}
    assert greeting.is_over
    assert greeting.version == 2


def test_every_greeting_has_a_nonce_of_its_own() -> None:
    nonces = {say(Greeting(TOKEN), FrameType.HELLO, HELLO)["nonce"] for _ in range(50)}
    assert len(nonces) == 50
    assert make_nonce() != make_nonce()


def refuse(proof: str) -> None:
    """Check that nobody is let in with this proof; ``{…}`` stands for what the trainer said."""
    greeting = Greeting(TOKEN)
    challenge = say(greeting, FrameType.HELLO, HELLO)
    nonces = HELLO["nonce"], challenge["nonce"]
    proofs = {
        "reflected": challenge["proof"],
        "of another token": make_proof("another token of 16", "engine", *nonces),
        "of the other role": make_proof(TOKEN, "trainer", *nonces),
        "for swapped nonces": make_proof(TOKEN, "engine", *reversed(nonces)),
        "for another challenge": make_proof(TOKEN, "engine", nonces[0], "00" * 32),
        "upper case": make_proof(TOKEN, "engine", *nonces).upper(),
        "too short": make_proof(TOKEN, "engine", *nonces)[:-1],
    }
    with pytest.raises(GreetingRefused, match="token is not ours") as caught:
        say(greeting, FrameType.PROOF, {"proof": proofs.get(proof, proof)})
    assert caught.value.code == "token"
    assert TOKEN not in str(caught.value)
    assert not greeting.is_over
    assert not greeting.is_over or greeting.state.state.name == "PROVEN"


@pytest.mark.parametrize(
    "proof",
    [
        "reflected",
        "of another token",
        "of the other role",
        "for swapped nonces",
        "for another challenge",
        "upper case",
        "too short",
        "",
        TOKEN,
        "\ud800",
    ],
)
def test_a_wrong_proof_is_refused(proof: str) -> None:
    refuse(proof)


def test_a_nonce_of_ours_sent_back_is_of_no_use() -> None:
    """Who lets us answer our own challenge has the proof of a trainer, not of an engine."""
    first, second = Greeting(TOKEN), Greeting(TOKEN)
    ours = say(first, FrameType.HELLO, HELLO)
    mirrored = say(second, FrameType.HELLO, {**HELLO, "nonce": ours["nonce"]})
    with pytest.raises(GreetingRefused):
        say(first, FrameType.PROOF, {"proof": mirrored["proof"]})


def test_protocol_1_is_for_a_game_that_was_started_here() -> None:
    trusting = Greeting(TOKEN, takes_protocol_1=True)
    assert say(trusting, FrameType.HELLO, OLD_HELLO) == {}
    assert trusting.is_over
    with pytest.raises(GreetingRefused, match="protocol 1") as caught:
        say(Greeting(TOKEN), FrameType.HELLO, OLD_HELLO)
    assert caught.value.code == "version"
    engine = OLD_HELLO["engine"]["name"]
    assert engine == "bevy"
    assert "bevy_ludus" in caught.value.hint
    godot = {**OLD_HELLO, "engine": HELLO["engine"]}
    with pytest.raises(GreetingRefused, match="protocol 1") as caught:
        say(Greeting(TOKEN), FrameType.HELLO, godot)
    assert caught.value.hint == "run `ludus addon install PROJECT`"


def test_an_engine_that_knows_both_protocols_proves_itself() -> None:
    """Or a stranger that claims so could leave it out."""
    greeting = Greeting(TOKEN, takes_protocol_1=True)
    say(greeting, FrameType.HELLO, {**HELLO, "protocol": {"min": 1, "max": 2}})
    assert not greeting.is_over
    assert greeting.version == 2


@pytest.mark.parametrize("nonce", ["", "00", "0" * 63, "g" * 64, "A" * 64, "0" * 65])
def test_a_nonce_has_64_hexadecimal_digits(nonce: str) -> None:
    with pytest.raises(ProtocolError, match=r"HELLO\.nonce"):
        say(Greeting(TOKEN), FrameType.HELLO, {**HELLO, "nonce": nonce})


@pytest.mark.parametrize(
    "wrong",
    [
        {"protocol": {"min": 8, "max": 9}},
        {"protocol": {"min": 1, "max": 1}},
        {"protocol": 7},
        {"capabilities": None},
    ],
)
def test_a_refusal_in_place_of_a_challenge_proves_that_it_is_ours(wrong: dict[str, Any]) -> None:
    greeting = Greeting(TOKEN)
    with pytest.raises((GreetingRefused, ProtocolError)):
        say(greeting, FrameType.HELLO, {**HELLO, **wrong})
    refusal = greeting.refusal(REPORT)
    nonces = HELLO["nonce"], refusal.pop("nonce")
    assert is_hex(nonces[1])
    assert refusal.pop("proof") == reference_proof(TOKEN, "trainer", *nonces)
    assert refusal == REPORT


def test_other_errors_have_no_proof() -> None:
    """Before there is a nonce of the engine, and after the challenge, which has one."""
    greeting = Greeting(TOKEN)
    assert greeting.refusal(REPORT) == REPORT
    say(greeting, FrameType.HELLO, HELLO)
    assert greeting.refusal(REPORT) == REPORT
    for nonce in ("", "A" * 64, 7, None):
        nameless = Greeting(TOKEN)
        with pytest.raises(ProtocolError):
            say(nameless, FrameType.HELLO, {**HELLO, "nonce": nonce})
        assert nameless.refusal(REPORT) == REPORT


def test_no_token_is_no_secret() -> None:
    with pytest.raises(ValueError, match="empty token"):
        Greeting("")


@pytest.mark.parametrize(
    "frame_type", [kind for kind in FrameType if kind.value not in {1, 11, 12}]
)
def test_nothing_but_a_hello_begins(frame_type: FrameType) -> None:
    with pytest.raises(ProtocolError, match=f"sent {frame_type.name} in CONNECTED"):
        Greeting(TOKEN).state.receive(frame_type)


def test_odd_greetings_raise_only_documented_errors_and_let_nobody_in() -> None:
    for path in places(HELLO):
        for odd in ODD_VALUES:
            assert not is_let_in(put(HELLO, path, odd), {"proof": "0" * 64})
    for odd in ODD_VALUES:
        assert not is_let_in(HELLO, {"proof": odd})
        assert not is_let_in(HELLO, odd)


def test_random_proofs_let_nobody_in() -> None:
    chance = random.Random(22)
    for _ in range(300):
        num_digits = chance.choice([0, 1, 63, 64, 64, 64, 65, 200])
        proof = "".join(chance.choice("0123456789abcdef\x00ü") for _ in range(num_digits))
        assert not is_let_in(HELLO, {"proof": proof})


def is_let_in(hello: Any, proof: Any) -> bool:
    greeting = Greeting(TOKEN)
    with contextlib.suppress(ProtocolError, EngineStartError):
        for frame_type, content in ((FrameType.HELLO, hello), (FrameType.PROOF, proof)):
            greeting.state.receive(frame_type)
            text = json.dumps(content).replace("Infinity", "1e999")
            greeting.answer(frame_type, text.encode())
        return greeting.is_over
    return False
