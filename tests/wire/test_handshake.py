"""``HELLO``, ``WELCOME`` and the choice of a version (PROTOCOL.md §3)."""

from __future__ import annotations

from typing import Any

import pytest

from ludus.errors import EngineStartError, ProtocolError
from ludus.wire import handshake
from ludus.wire.handshake import EngineConfig, Hello, welcome
from tests.wire.golden import load

HELLO = {**load("hello").content}

# (the engine's range, ours) → the version chosen, or the side to upgrade
MATRIX = [
    ((1, 1), (1, 1), 1),
    ((1, 3), (1, 1), 1),
    ((1, 3), (1, 2), 2),
    ((1, 3), (2, 5), 3),
    ((2, 2), (1, 3), 2),
    ((3, 9), (1, 3), 3),
    ((2, 3), (1, 1), "pip install --upgrade"),
    ((1, 1), (2, 3), "ludus addon install"),
    ((0, 0), (1, 1), "ludus addon install"),
    ((9, 9), (1, 3), "pip install --upgrade"),
]


def hello_of(low: int, high: int) -> Hello:
    return Hello.from_json({**HELLO, "protocol": {"min": low, "max": high}})


@pytest.mark.parametrize(("engine", "ours", "outcome"), MATRIX)
def test_the_highest_common_version_is_chosen_or_the_side_to_upgrade_named(
    monkeypatch: pytest.MonkeyPatch,
    engine: tuple[int, int],
    ours: tuple[int, int],
    outcome: int | str,
) -> None:
    monkeypatch.setattr(handshake, "PROTOCOL_MIN", ours[0])
    monkeypatch.setattr(handshake, "PROTOCOL_MAX", ours[1])
    if isinstance(outcome, int):
        assert hello_of(*engine).agree() == outcome
        return
    with pytest.raises(EngineStartError) as caught:
        hello_of(*engine).agree()
    assert outcome in caught.value.hint
    assert f"protocol {engine[0]} to {engine[1]}, ludus {ours[0]} to {ours[1]}" in str(caught.value)


@pytest.mark.parametrize("key", ["protocol", "addon", "engine", "capabilities"])
def test_a_missing_key_is_named(key: str) -> None:
    value = {name: part for name, part in HELLO.items() if name != key}
    with pytest.raises(ProtocolError, match=rf"^HELLO\.{key}: missing$"):
        Hello.from_json(value)


@pytest.mark.parametrize(
    ("key", "value", "what"),
    [
        ("protocol", 1, "protocol: expected an object, got 1"),
        ("protocol", {"min": 1}, "protocol.max: missing"),
        ("protocol", {"min": "one", "max": 1}, "protocol.min: expected an integer, got 'one'"),
        ("protocol", {"min": None, "max": 1}, "protocol.min: expected an integer, got None"),
        ("protocol", {"min": 1, "max": float("inf")}, "protocol.max: expected an integer, got inf"),
        ("engine", "godot", "engine: expected an object, got 'godot'"),
        ("engine", {"name": "godot"}, "engine.version: missing"),
        ("addon", 1, "addon: expected a text, got 1"),
        ("capabilities", "call", "capabilities: expected a list, got 'call'"),
        ("capabilities", None, "capabilities: expected a list, got None"),
        ("capabilities", {"call": True}, "capabilities: expected a list, got {'call': True}"),
        ("nonce", 7, "nonce: expected a text, got 7"),
    ],
)
def test_a_wrong_field_is_named(key: str, value: Any, what: str) -> None:
    with pytest.raises(ProtocolError) as caught:
        Hello.from_json({**HELLO, key: value})
    assert caught.value.message == f"HELLO.{what}"


def test_an_engine_of_protocol_1_has_no_nonce_and_its_token_is_not_kept() -> None:
    old = Hello.from_json(load("hello_protocol_1").content)
    assert (old.nonce, old.agree()) == ("", 1)
    assert "16" not in repr(old).replace("0.16", "")


def test_only_common_capabilities_are_used() -> None:
    hello = Hello.from_json({**HELLO, "capabilities": ["telepathy", "call"]})
    assert welcome(2, hello, EngineConfig())["capabilities"] == ["call"]


def test_the_answer_carries_the_settings() -> None:
    config = EngineConfig(scene="res://a.tscn", num_worlds=7, first_world=14, layout="grid")
    answer = welcome(1, hello_of(1, 1), config)
    assert answer["config"]["num_worlds"] == 7
    assert answer["config"]["first_world"] == 14
    assert answer["config"]["ticks_per_step"] is None
    assert "token" not in answer
