"""The training settings of a game that guides its training (PROTOCOL.md §3)."""

from __future__ import annotations

import contextlib
from typing import Any

import pytest
from hypothesis import given

from ludus.errors import ProtocolError
from ludus.wire.handshake import CAPABILITIES, EngineConfig, Hello, welcome
from ludus.wire.training import CAPABILITY, Training, read_training
from tests.wire.golden import load
from tests.wire.strategies import json_values
from tests.wire.test_fuzz import ODD_VALUES, places, put

GOLDEN = load("hello_training").content


def test_the_golden_greeting_is_read() -> None:
    hello = Hello.from_json(GOLDEN)
    assert read_training(hello.training) == Training("find_coin", 50, None, 100)


def test_all_keys_are_optional() -> None:
    assert read_training({}) == Training(None, 1, None, None)
    assert Hello.from_json(load("hello").content).training is None


def test_whole_numbers_may_be_floats() -> None:
    assert read_training({"num_worlds": 50.0, "seed": 7.0}) == Training(None, 50, 7, None)


@pytest.mark.parametrize("run", ["a", "find_coin", "Coin-2.1", "_", "7", "x" * 64])
def test_valid_names_of_runs_are_accepted(run: str) -> None:
    assert read_training({"run": run}).run == run


@pytest.mark.parametrize(
    ("key", "values"),
    [
        ("run", ["", ".", "..", ".hidden", "-v", "a/b", "a\\b", "a b", "ä", "x" * 65, "a\n", 3]),
        ("num_worlds", [0, -1, 65_537, 1.5, "3", True, float("inf"), [1]]),
        ("seed", [-1, 2**63, 0.5, "", False]),
        ("checkpoint_every_updates", [0, -5, "often", 1e300]),
    ],
)
def test_a_wrong_setting_is_named(key: str, values: list[Any]) -> None:
    for value in values:
        with pytest.raises(ProtocolError, match=rf"HELLO\.training\.{key}: expected") as caught:
            read_training({key: value})
        assert "LudusTraining" in caught.value.hint


def test_an_odd_value_in_any_field_raises_only_protocol_errors() -> None:
    for path in places(GOLDEN["training"]):
        for odd in ODD_VALUES:
            with contextlib.suppress(ProtocolError):
                read_training(put(GOLDEN["training"], path, odd))


@given(json_values)
def test_any_json(value: Any) -> None:
    with contextlib.suppress(ProtocolError):
        read_training(value)


def test_a_trainer_agrees_to_guided_training_only_if_it_offers_it() -> None:
    hello = Hello.from_json(GOLDEN)
    assert CAPABILITY not in CAPABILITIES
    assert CAPABILITY not in welcome(1, hello, EngineConfig())["capabilities"]
    guided = welcome(1, hello, EngineConfig(), more=frozenset({CAPABILITY}))
    assert CAPABILITY in guided["capabilities"]
    old = Hello.from_json(load("hello").content)
    more = frozenset({CAPABILITY})
    assert CAPABILITY not in welcome(1, old, EngineConfig(), more=more)["capabilities"]
