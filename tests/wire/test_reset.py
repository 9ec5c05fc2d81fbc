"""``RESET`` payloads (PROTOCOL.md §5)."""

from __future__ import annotations

from typing import Any

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from ludus.errors import UsageError
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
def test_the_reference_reads_it(request_: ResetRequest) -> None:
    read = reference.decode_reset(request_.encode()[8:])
    assert [int(seed, 16) for seed in read["seeds"]] == request_.seeds.tolist()
    assert read["actions"] == request_.actions.tolist()
    assert read["parameters"] == request_.parameters


def test_seeds_count_up_and_wrap() -> None:
    request_ = ResetRequest.all_worlds(3, 2**64 - 2)
    assert request_.seeds.tolist() == [2**64 - 2, 2**64 - 1, 0]
    assert request_.actions.tolist() == [ResetAction.SEED] * 3


def test_without_a_seed_worlds_continue_their_random_streams() -> None:
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
