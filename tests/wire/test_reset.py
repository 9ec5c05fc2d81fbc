"""``RESET`` payloads (PROTOCOL.md §5)."""

from __future__ import annotations

import struct
from typing import Any

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from ludus.errors import ProtocolError, UsageError
from ludus.wire.reset import ResetAction, ResetRequest
from tests.wire import reference
from tests.wire.strategies import json_objects


@st.composite
def requests(draw: st.DrawFn) -> ResetRequest:
    num = draw(st.integers(1, 9))
    seeds = draw(st.lists(st.integers(0, 2**64 - 1), min_size=num, max_size=num))
    actions = draw(st.lists(st.sampled_from(ResetAction), min_size=num, max_size=num))
    per_world = st.lists(st.none() | json_objects, min_size=num, max_size=num)
    parameters = draw(st.none() | json_objects | per_world)
    return ResetRequest(np.array(seeds, np.uint64), np.array(actions, np.uint8), parameters)


@given(requests())
def test_round_trip(request_: ResetRequest) -> None:
    frame = request_.encode()
    read = ResetRequest.decode(frame[8:])
    assert read.seeds.tolist() == request_.seeds.tolist()
    assert read.actions.tolist() == request_.actions.tolist()
    assert read.parameters == request_.parameters
    assert read.encode() == frame


@given(requests())
def test_the_reference_reads_it(request_: ResetRequest) -> None:
    read = reference.decode_reset(request_.encode()[8:])
    assert [int(seed, 16) for seed in read["seeds"]] == request_.seeds.tolist()
    assert read["actions"] == request_.actions.tolist()
    assert read["parameters"] == request_.parameters


def test_seeds_count_up_and_wrap() -> None:
    request_ = ResetRequest.all_worlds(3, 2**64 - 2)
    assert request_.seeds.tolist() == [2**64 - 2, 2**64 - 1, 0]
    assert request_.actions.tolist() == [ResetAction.SEED] * 3


def test_no_seed_goes_on_with_the_random_stream() -> None:
    assert ResetRequest.all_worlds(2, None).actions.tolist() == [ResetAction.NEXT_EPISODE] * 2


@pytest.mark.parametrize(
    "parameters", [{"a": object()}, {"a": float("nan")}, {"a": float("inf")}, {"a": {1, 2}}]
)
def test_parameters_must_be_json(parameters: Any) -> None:
    with pytest.raises(UsageError, match=r"(?s)must be JSON.*hint: use numbers"):
        ResetRequest.all_worlds(1, 0, parameters).encode()


def test_parameters_are_one_per_world() -> None:
    with pytest.raises(UsageError, match="parameters for 2 worlds, there are 3"):
        ResetRequest.all_worlds(3, 0, [{}, None]).encode()


def payload_of(
    num_worlds: int, actions: bytes, text: bytes, text_bytes: int | None = None
) -> bytes:
    body = bytes(8 * num_worlds) + actions
    body += bytes(-len(body) % 8)
    return struct.pack("<II", num_worlds, len(text) if text_bytes is None else text_bytes) + (
        body + text
    )


@pytest.mark.parametrize(
    ("payload", "what"),
    [
        (b"", "too short"),
        (bytes(7), "too short"),
        (payload_of(1, b"\x00", b"null") + b" ", "expected"),
        (payload_of(1, b"\x00", b"null")[:-1], "expected"),
        (payload_of(1, b"\x00", b"null", 2**32 - 1), "expected"),
        (struct.pack("<II", 2**32 - 1, 0), "65536"),
        (payload_of(0, b"", b"null"), "65536"),
        (payload_of(2, b"\x00\x03", b"null"), "unknown action"),
        (payload_of(1, b"\x00", b"{"), "not JSON"),
        (payload_of(1, b"\x00", b""), "not JSON"),
        (payload_of(1, b"\x00", b"\xff\xff"), "not JSON"),
        (payload_of(1, b"\x00", "null".encode("utf-16")), "not JSON"),
        (payload_of(1, b"\x00", b'{"a":NaN}'), "not JSON"),
        (payload_of(1, b"\x00", b"[" * 100_000), "not JSON"),
        (payload_of(1, b"\x00", b"7"), "null, an object or a list"),
        (payload_of(2, b"\x00\x00", b"[null]"), "null, an object or a list"),
        (payload_of(2, b"\x00\x00", b"[null,7]"), "null, an object or a list"),
    ],
)
def test_a_malformed_request_is_refused(payload: bytes, what: str) -> None:
    with pytest.raises(ProtocolError, match=what):
        ResetRequest.decode(payload)
