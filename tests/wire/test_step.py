"""``STEP`` and ``BATCH`` of any spec, against the reference (PROTOCOL.md §6 and §7)."""

from __future__ import annotations

import struct
from typing import Any

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from ludus.errors import ActionError, ProtocolError
from ludus.spec import Spec
from ludus.spec.batch import ActionBatch, Batches
from ludus.wire.frames import FrameType
from ludus.wire.step import BatchDecoder, StepEncoder
from tests.wire import reference
from tests.wire.golden import Golden, actions, load, load_all
from tests.wire.strategies import actions as action_strategy
from tests.wire.strategies import batch_contents, specs

SPEC = load("batch_policies").spec
STEP = load("step_policies")
BATCH = load("batch_policies")


def decode(spec: Spec, payload: bytes) -> tuple[BatchDecoder, Batches]:
    decoder = BatchDecoder(spec)
    room = len(decoder.buffer)
    decoder.buffer[8 : 8 + len(payload)] = payload[: room - 8]
    assert len(decoder.buffer) == room
    return decoder, decoder.decode(len(payload))


def same(numbers: Any, expected: Any) -> bool:
    """Compare to the bit, so that NaN equals NaN and -0 is not 0."""
    return numbers.tobytes() == np.array(expected, numbers.dtype).tobytes()


@given(st.data())
def test_step_is_what_the_engine_reads(data: st.DataObject) -> None:
    spec = data.draw(specs())
    sent = data.draw(action_strategy(spec))
    frame = StepEncoder(spec).encode(sent)
    assert struct.unpack_from("<IBBH", frame) == (len(frame) - 8, FrameType.STEP, 0, 0)
    read = reference.decode_step(spec.to_json(), bytes(frame[8:]))
    for name, action in sent.items():
        assert same(action.discrete, read["policies"][name]["discrete"])
        assert same(action.continuous, read["policies"][name]["continuous"])


@given(st.data())
def test_batch_is_what_the_engine_wrote(data: st.DataObject) -> None:
    spec = data.draw(specs())
    content = data.draw(batch_contents(spec))
    decoder, batches = decode(spec, reference.encode_batch(spec.to_json(), content))
    assert decoder.is_reset == content["is_reset"]
    assert decoder.has_requests == content["has_requests"]
    assert decoder.times.tick == content["tick"]
    assert list(batches) == [policy.name for policy in spec.policies]
    for name, batch in batches.items():
        part = content["policies"][name]
        for entry, values in batch.observation.items():
            assert same(values, part["observation"][entry])
            final = batch.final_observation[entry]
            assert same(final, part["final"]["observation"][entry])
            assert final.shape[1:] == values.shape[1:]
        for field in ("reward", "terminated", "truncated", "active"):
            assert same(getattr(batch, field), part[field])
        assert batch.final_index.tolist() == part["final"]["slots"]
        assert (batch.action_mask is not None) == ("action_mask" in part)
        if batch.action_mask is not None:
            assert same(batch.action_mask, part["action_mask"])


@given(st.data())
def test_the_fast_check_passes_finite_numbers_only(data: st.DataObject) -> None:
    spec = data.draw(specs())
    content = data.draw(batch_contents(spec))
    decoder, batches = decode(spec, reference.encode_batch(spec.to_json(), content))
    numbers = [batch.reward for batch in batches.values()]
    for batch in batches.values():
        numbers += [*batch.observation.values(), *batch.final_observation.values()]
    is_finite = all(np.isfinite(values).all() for values in numbers)
    are_small = all((np.abs(values) < 2.0).all() for values in numbers if values.dtype.kind == "f")
    assert decoder.all_finite_fast() <= is_finite
    assert decoder.all_finite_fast() >= are_small


def test_the_step_buffer_is_used_again() -> None:
    encoder = StepEncoder(SPEC)
    first = encoder.encode(actions(SPEC, STEP.content))
    zeros = {policy.name: ActionBatch.zeros(policy, policy.num_agents) for policy in SPEC.policies}
    assert encoder.encode(zeros) is first
    assert bytes(first[8:]) == bytes(len(first) - 8)


def test_a_missing_policy_is_named() -> None:
    sent = actions(SPEC, STEP.content)
    del sent["hero"]
    with pytest.raises(ActionError, match="no actions for policy hero"):
        StepEncoder(SPEC).encode(sent)


@pytest.mark.parametrize("kind", ["discrete", "continuous"])
def test_a_wrong_shape_is_named(kind: str) -> None:
    sent = actions(SPEC, STEP.content)
    hero = sent["hero"]
    wrong = {"discrete": hero.discrete, "continuous": hero.continuous, kind: np.zeros((2, 7))}
    sent["hero"] = ActionBatch(**wrong)  # pyright: ignore[reportArgumentType]
    with pytest.raises(ActionError, match=rf"hero\.{kind}: expected .* got \(2, 7\)"):
        StepEncoder(SPEC).encode(sent)


@pytest.mark.parametrize("golden", load_all(FrameType.BATCH), ids=lambda golden: golden.name)
def test_a_batch_of_another_size_is_refused(golden: Golden) -> None:
    room = len(BatchDecoder(golden.spec).buffer) - 8
    for size in range(room + 1):
        if size == len(golden.payload):
            continue
        with pytest.raises(ProtocolError, match="BATCH"):
            decode(golden.spec, (golden.payload + bytes(room))[:size])


def with_final_slots(slots: list[int], count: int | None = None) -> bytes:
    content = reference.quiet_batch(BATCH.spec_json)
    zeros = [[0.0]] * 2
    final = {"slots": slots, "observation": {"place": [zeros] * len(slots)}}
    content["policies"]["Ziel ✓"]["final"] = final
    payload = bytearray(reference.encode_batch(BATCH.spec_json, content))
    if count is not None:
        size = 8 + 8 * ((len(slots) + 1) // 2) + 8 * len(slots)
        struct.pack_into("<I", payload, len(payload) - size, count)
    return bytes(payload)


def test_final_slots_are_read() -> None:
    _, batches = decode(SPEC, with_final_slots([0, 3, 5]))
    assert batches["Ziel ✓"].final_index.tolist() == [0, 3, 5]
    assert batches["hero"].final_index.tolist() == []


@pytest.mark.parametrize("slots", [[6], [1, 1], [3, 2], [0, 2**32 - 1]])
def test_bad_final_slots_are_refused(slots: list[int]) -> None:
    with pytest.raises(ProtocolError, match="final slots of Ziel ✓"):
        decode(SPEC, with_final_slots(slots))


@pytest.mark.parametrize("count", [2, 3, 7, 2**32 - 1])
def test_a_false_number_of_final_observations_is_refused(count: int) -> None:
    with pytest.raises(ProtocolError, match="BATCH"):
        decode(SPEC, with_final_slots([1], count))


def test_finals_of_the_last_frame_are_forgotten() -> None:
    decoder, batches = decode(SPEC, with_final_slots([1, 2]))
    payload = with_final_slots([])
    decoder.buffer[8 : 8 + len(payload)] = payload
    decoder.decode(len(payload))
    assert batches["Ziel ✓"].final_index.tolist() == []
    assert batches["Ziel ✓"].final_observation["place"].shape == (0, 2, 1)
