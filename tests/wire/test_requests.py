"""What a game may ask of its trainer (PROTOCOL.md §8)."""

from __future__ import annotations

import contextlib
import re
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ludus.errors import ProtocolError
from ludus.wire.handshake import CAPABILITIES
from ludus.wire.requests import CAPABILITY, MODES, read_requests
from tests.wire.golden import FOLDER, load
from tests.wire.strategies import json_values
from tests.wire.test_fuzz import ODD_VALUES, places, put

GOLDEN = load("result_requests").content["value"]
METRICS = load("result_requests_metrics").content["value"]
GUIDED = load("result_requests_guided").content["value"]
WATCH = load("result_requests_watch").content["value"]
METRIC = {"count": 1, "sum": 2.0, "min": 2.0, "max": 2.0}
SET_MODE = {"kind": "set_mode", "policy": "hero", "mode": "frozen"}


def test_golden_requests_are_read() -> None:
    assert read_requests(GOLDEN) == GOLDEN
    assert read_requests(GUIDED) == GUIDED
    assert read_requests(METRICS) == METRICS
    assert read_requests(WATCH) == WATCH
    assert {request["mode"] for request in GOLDEN if "mode" in request} == set(MODES)


def test_the_page_names_every_kind_and_mode() -> None:
    page = (FOLDER.parent / "PROTOCOL.md").read_text(encoding="utf-8")
    table = page[page.index("| kind | what the trainer does |") :]
    table = table[: table.index("\n\n")]
    kinds = re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE)
    golden = GOLDEN + GUIDED + METRICS + WATCH
    assert list(dict.fromkeys(request["kind"] for request in golden)) == kinds
    assert all(f"`{mode}`" in table for mode in MODES)
    assert CAPABILITY in CAPABILITIES


@pytest.mark.parametrize(
    "value",
    [
        [],
        [{"kind": "play_round", "number": 3}],
        [{**SET_MODE, "policy": "no policy at all", "reason": "a key to come"}],
        [{"kind": "a" * 128}] * 256,
    ],
    ids=["none", "unknown kind", "unknown policy", "the limits"],
)
def test_unknown_kinds_policies_and_keys_are_accepted(value: Any) -> None:
    assert read_requests(value) == value


WRONG: list[tuple[Any, str]] = [
    (None, r"take_requests\(\): expected a list, got None"),
    ({"kind": "save"}, r"take_requests\(\): expected a list"),
    ([{"kind": "metrics"}], r"\[0\]\.metrics: missing"),
    ([{"kind": "metrics", "metrics": {}}], r"metrics: expected 1 to 64 names, got 0"),
    ([{"kind": "metrics", "metrics": {"a\n": METRIC}}], "without control characters"),
    ([{"kind": "metrics", "metrics": {"a": {**METRIC, "count": 0}}}], r"metrics\.a\.count: exp"),
    ([{"kind": "metrics", "metrics": {"a": {**METRIC, "sum": None}}}], r"a\.sum: expected a num"),
    ([{"kind": "save"}] * 257, r"take_requests\(\): expected 0 to 256 items, got 257"),
    ([{"kind": "save"}, "save"], r"take_requests\(\)\[1\]: expected an object, got 'save'"),
    ([{}], r"\[0\]\.kind: missing"),
    ([{"kind": 7}], r"\.kind: expected a text, got 7"),
    ([{"kind": ""}], r"\.kind: expected a word"),
    ([{"kind": "Save"}], r"\.kind: expected a word"),
    ([{"kind": "save\n"}], r"\.kind: expected a word"),
    ([{"kind": "\ud800"}], r"\.kind: expected a word"),
    ([{"kind": "a" * 129}], r"\.kind: expected a word"),
    ([{**SET_MODE, "policy": None}], r"\.policy: expected a text, got None"),
    ([{**SET_MODE, "policy": ""}], r"\.policy: expected a name of 1 to 128 characters"),
    ([{**SET_MODE, "policy": "x" * 129}], r"\.policy: expected a name of 1 to 128 characters"),
    ([{"kind": "set_mode", "policy": "hero"}], r"\.mode: missing"),
    (
        [{**SET_MODE, "mode": "asleep"}],
        r"\.mode: expected one of train, frozen, deterministic, got 'asleep'",
    ),
    ([{**SET_MODE, "mode": ["train"]}], r"\.mode: expected a text, got \['train'\]"),
]


@pytest.mark.parametrize(("value", "what"), WRONG)
def test_a_malformed_request_is_named(value: Any, what: str) -> None:
    with pytest.raises(ProtocolError, match=what) as caught:
        read_requests(value)
    assert len(caught.value.message) < 200


@given(json_values | st.lists(st.dictionaries(st.sampled_from(["kind", "policy"]), json_values)))
def test_any_json(value: Any) -> None:
    with contextlib.suppress(ProtocolError):
        assert_sound(read_requests(value))


@pytest.mark.parametrize("odd", ODD_VALUES, ids=lambda odd: repr(odd)[:20])
def test_an_odd_value_in_any_field_raises_only_protocol_errors(odd: Any) -> None:
    for path in places(GOLDEN):
        with contextlib.suppress(ProtocolError):
            assert_sound(read_requests(put(GOLDEN, path, odd)))


def assert_sound(requests: list[dict[str, Any]]) -> None:
    """What comes out has the parts that a trainer relies on."""
    for request in requests:
        assert re.fullmatch("[a-z0-9_]+", request["kind"])
        if request["kind"] == "set_mode":
            assert isinstance(request["policy"], str)
            assert request["mode"] in MODES
