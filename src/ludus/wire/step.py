"""``STEP`` and ``BATCH`` payloads as structures of arrays (PROTOCOL.md §6 and §7).

Their sizes follow from the spec, so both sides allocate once. No input or output happens here.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ludus.errors import ActionError, ProtocolError
from ludus.spec import PolicySpec, Spec
from ludus.spec.batch import ActionBatch, Batch, Batches, StepTimes
from ludus.spec.finite import all_finite_fast
from ludus.wire.frames import HEADER, HEADER_BYTES, FrameType, padded

__all__ = ["BatchDecoder", "StepEncoder", "max_batch_bytes"]

_HEAD = struct.Struct("<QIIII")
_FLAG_RESET = 1
_FLAG_REQUESTS = 2
_FINAL_HEAD = struct.Struct("<II")
_SLOT = np.dtype("<u4")


class StepEncoder:
    """Writes ``STEP`` frames for one engine into one buffer, which it reuses."""

    def __init__(self, spec: Spec) -> None:
        self._policies = spec.policies
        sizes = [_action_bytes(policy) for policy in spec.policies]
        num_bytes = sum(discrete + continuous for discrete, continuous in sizes)
        self._frame = bytearray(HEADER_BYTES + num_bytes)
        HEADER.pack_into(self._frame, 0, num_bytes, FrameType.STEP, 0, 0)
        self._slots: dict[str, ActionBatch] = {}
        offset = HEADER_BYTES
        for policy, (discrete_bytes, continuous_bytes) in zip(spec.policies, sizes, strict=True):
            num, choices, size = policy.num_agents, policy.num_discrete, policy.continuous_size
            discrete = np.frombuffer(self._frame, "<i8", num * choices, offset)
            offset += discrete_bytes
            continuous = np.frombuffer(self._frame, "<f4", num * size, offset)
            offset += continuous_bytes
            self._slots[policy.name] = ActionBatch(
                discrete.reshape(num, choices), continuous.reshape(num, size)
            )

    def encode(self, actions: Mapping[str, ActionBatch]) -> bytearray:
        """Return the frame; the next call overwrites it.

        Raises:
            ActionError: A policy is missing, or its arrays have the wrong shape.
        """
        for policy in self._policies:
            action = actions.get(policy.name)
            if action is None:
                raise ActionError(f"no actions for policy {policy.name}")
            slot = self._slots[policy.name]
            _copy(slot.discrete, action.discrete, policy.name, "discrete")
            _copy(slot.continuous, action.continuous, policy.name, "continuous")
        return self._frame


class BatchDecoder:
    """Reads ``BATCH`` frames of one engine in place.

    ``buffer`` holds a whole frame, header included; its arrays are views made once. Final
    observations, whose number varies, follow the fixed part.
    """

    def __init__(self, spec: Spec) -> None:
        self._spec = spec
        self._fixed_bytes = _fixed_bytes(spec)
        self.buffer = bytearray(HEADER_BYTES + max_batch_bytes(spec))
        self._batches: Batches = {}
        offset = HEADER_BYTES + _HEAD.size
        for policy in spec.policies:
            self._batches[policy.name] = _batch_views(self.buffer, policy, offset)
            offset += _batch_bytes(policy)
        self._spans = _float_spans(self.buffer, self._batches)
        self._min_bytes = self._fixed_bytes + _FINAL_HEAD.size * len(spec.policies)
        empty = ((policy.name, Batch.allocate(policy, 0)) for policy in spec.policies)
        self._no_finals = {name: (b.final_index, b.final_observation) for name, b in empty}
        self.times = StepTimes(0, 0, 0, 0)
        self.is_reset = False
        self.has_requests = False

    def decode(self, num_bytes: int) -> Batches:
        """Decode a payload of ``num_bytes`` that follows the header in :attr:`buffer`.

        Returns:
            Views of the buffer; the next frame overwrites them.

        Raises:
            ProtocolError: The payload's size does not match the spec, or slots are wrong.
        """
        if num_bytes < self._min_bytes:
            raise ProtocolError(f"BATCH has {num_bytes} bytes, the spec needs {self._min_bytes}")
        tick, engine_us, bridge_us, wait_us, flags = _HEAD.unpack_from(self.buffer, HEADER_BYTES)
        self.times = StepTimes(tick, engine_us, bridge_us, wait_us)
        self.is_reset = bool(flags & _FLAG_RESET)
        self.has_requests = bool(flags & _FLAG_REQUESTS)
        self._decode_final(num_bytes)
        return self._batches

    def all_finite_fast(self) -> bool:
        """Check the floats of the last frame; see :func:`ludus.spec.finite.all_finite_fast`."""
        if not all_finite_fast(self._spans):
            return False
        for batch in self._batches.values():
            if len(batch.final_index):
                finals = batch.final_observation.values()
                if not all_finite_fast(values for values in finals if values.dtype.kind == "f"):
                    return False
        return True

    def _decode_final(self, num_bytes: int) -> None:
        offset = HEADER_BYTES + self._fixed_bytes
        end = HEADER_BYTES + num_bytes
        for policy in self._spec.policies:
            batch = self._batches[policy.name]
            if offset + _FINAL_HEAD.size > end:
                raise ProtocolError("BATCH ends inside its final observations")
            count, _ = _FINAL_HEAD.unpack_from(self.buffer, offset)
            if count == 0:
                batch.final_index, batch.final_observation = self._no_finals[policy.name]
                offset += _FINAL_HEAD.size
                continue
            if count > policy.num_agents:
                raise ProtocolError(f"BATCH has {count} final observations of {policy.name}")
            offset = self._read_final(policy, batch, offset + _FINAL_HEAD.size, count, end)
        if offset != end:
            raise ProtocolError(f"BATCH has {end - offset} bytes too many")

    def _read_final(
        self, policy: PolicySpec, batch: Batch, offset: int, count: int, end: int
    ) -> int:
        # np.ndarray over the buffer takes half as long as slicing and reshaping a view.
        index = np.ndarray((count,), _SLOT, self.buffer, offset).astype(np.int64)
        offset += padded(count * _SLOT.itemsize)
        observation: dict[str, NDArray[Any]] = {}
        for entry in policy.observation:
            shape = (count, *entry.shape)
            observation[entry.name] = np.ndarray(shape, entry.numpy_dtype, self.buffer, offset)
            offset += padded(count * entry.num_bytes)
        if offset > end:
            raise ProtocolError(f"BATCH has {count} final observations of {policy.name}")
        is_ascending = np.count_nonzero(index[1:] > index[:-1]) == count - 1
        if index[-1] >= policy.num_agents or not is_ascending:
            raise ProtocolError(f"final slots of {policy.name} are out of range or not ascending")
        batch.final_index, batch.final_observation = index, observation
        return offset


def max_batch_bytes(spec: Spec) -> int:
    """Return the size of a ``BATCH`` payload in which the episodes of all agents end."""
    num_bytes = _fixed_bytes(spec)
    for policy in spec.policies:
        num = policy.num_agents
        entries = sum(padded(num * entry.num_bytes) for entry in policy.observation)
        num_bytes += _FINAL_HEAD.size + padded(num * 4) + entries
    return num_bytes


def _fixed_bytes(spec: Spec) -> int:
    return _HEAD.size + sum(_batch_bytes(policy) for policy in spec.policies)


def _action_bytes(policy: PolicySpec) -> tuple[int, int]:
    num = policy.num_agents
    return padded(num * policy.num_discrete * 8), padded(num * policy.continuous_size * 4)


def _copy(slot: NDArray[Any], values: NDArray[Any], policy: str, kind: str) -> None:
    if values.shape != slot.shape:
        raise ActionError(
            f"{policy}.{kind}: expected actions of shape {slot.shape}, got {values.shape}"
        )
    if slot.size:
        slot[...] = values


def _batch_bytes(policy: PolicySpec) -> int:
    num = policy.num_agents
    entries = sum(padded(num * entry.num_bytes) for entry in policy.observation)
    return entries + padded(num * 4) + 3 * padded(num) + padded(num * policy.mask_size)


def _float_spans(buffer: bytearray, batches: Batches) -> list[NDArray[Any]]:
    """Return the floats of the fixed part as flat arrays, neighbours of one dtype joined."""
    origin = np.frombuffer(buffer, np.uint8).ctypes.data
    spans: list[tuple[np.dtype[Any], int, int]] = []
    for batch in batches.values():
        for values in (*batch.observation.values(), batch.reward):
            if values.dtype.kind != "f":
                continue
            start = values.ctypes.data - origin
            end = start + values.nbytes
            if spans and spans[-1][0] == values.dtype and padded(spans[-1][2]) == start:
                start = spans.pop()[1]
            spans.append((values.dtype, start, end))
    return [
        np.frombuffer(buffer, dtype, (end - start) // dtype.itemsize, start)
        for dtype, start, end in spans
    ]


def _batch_views(buffer: bytearray, policy: PolicySpec, offset: int) -> Batch:
    num = policy.num_agents
    batch = Batch.allocate(policy, num)
    for entry in policy.observation:
        view = np.frombuffer(buffer, entry.numpy_dtype, num * entry.size, offset)
        batch.observation[entry.name] = view.reshape(num, *entry.shape)
        offset += padded(view.nbytes)
    batch.reward = np.frombuffer(buffer, "<f4", num, offset)
    offset += padded(num * 4)
    batch.terminated = np.frombuffer(buffer, np.bool_, num, offset)
    batch.truncated = np.frombuffer(buffer, np.bool_, num, offset + padded(num))
    batch.active = np.frombuffer(buffer, np.bool_, num, offset + 2 * padded(num))
    if policy.mask_size:
        mask = np.frombuffer(buffer, np.bool_, num * policy.mask_size, offset + 3 * padded(num))
        batch.action_mask = mask.reshape(num, policy.mask_size)
    return batch
