"""The ``RESET`` payload (PROTOCOL.md §5). No input or output."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ludus.errors import ProtocolError, UsageError
from ludus.wire.frames import MAX_WORLDS, FrameType, encode_frame, padded, parse_json

__all__ = ["Parameters", "ResetAction", "ResetRequest"]

Parameters = Mapping[str, Any] | Sequence[Mapping[str, Any] | None] | None
_HEAD = struct.Struct("<II")


class ResetAction(IntEnum):
    """What happens to a world."""

    LEAVE = 0
    NEXT_EPISODE = 1
    SEED = 2


@dataclass(frozen=True)
class ResetRequest:
    """Which worlds begin a new episode, and how.

    Attributes:
        seeds: ``uint64[num_worlds]``, used where the action is ``SEED``.
        actions: ``uint8[num_worlds]`` of :class:`ResetAction`.
        parameters: For every world that is reset, or one mapping or None per world.
    """

    seeds: NDArray[np.uint64]
    actions: NDArray[np.uint8]
    parameters: Parameters = None

    @classmethod
    def all_worlds(
        cls, num_worlds: int, seed: int | None, parameters: Parameters = None
    ) -> ResetRequest:
        """Reset every world; world *i* gets ``seed + i``, None goes on with its stream."""
        action = ResetAction.NEXT_EPISODE if seed is None else ResetAction.SEED
        seeds = [((seed or 0) + i) % (1 << 64) for i in range(num_worlds)]
        return cls(np.array(seeds, np.uint64), np.full(num_worlds, action, np.uint8), parameters)

    def encode(self) -> bytes:
        """Return the whole frame.

        Raises:
            UsageError: The parameters are not JSON, or not one per world.
        """
        num_worlds = len(self.seeds)
        text = self._parameter_text(num_worlds)
        body = self.seeds.astype("<u8").tobytes() + self.actions.astype("u1").tobytes()
        body += bytes(padded(len(body)) - len(body))
        return encode_frame(FrameType.RESET, _HEAD.pack(num_worlds, len(text)) + body + text)

    def _parameter_text(self, num_worlds: int) -> bytes:
        value: Any = self.parameters
        if value is not None and not isinstance(value, Mapping):
            value = list(value)
            if len(value) != num_worlds:
                raise UsageError(f"parameters for {len(value)} worlds, there are {num_worlds}")
        try:
            return json.dumps(value, separators=(",", ":"), allow_nan=False).encode()
        except (TypeError, ValueError) as error:
            raise UsageError(
                f"reset parameters must be JSON: {error}",
                hint="use numbers, texts, lists and dictionaries with text keys",
            ) from error

    @classmethod
    def decode(cls, payload: bytes) -> ResetRequest:
        """Read a payload; the counterpart of :meth:`encode`.

        Raises:
            ProtocolError: It is malformed.
        """
        if len(payload) < _HEAD.size:
            raise ProtocolError("RESET is too short")
        num_worlds, text_bytes = _HEAD.unpack_from(payload)
        if not 1 <= num_worlds <= MAX_WORLDS:
            raise ProtocolError(f"RESET of {num_worlds} worlds, expected 1 to {MAX_WORLDS}")
        start = _HEAD.size + padded(num_worlds * 9)
        if len(payload) != start + text_bytes:
            raise ProtocolError(f"RESET has {len(payload)} bytes, expected {start + text_bytes}")
        actions = np.frombuffer(payload, "u1", num_worlds, _HEAD.size + num_worlds * 8)
        if actions.size and actions.max() > ResetAction.SEED:
            raise ProtocolError("RESET asks for an unknown action")
        parameters = _read_parameters(payload[start:], num_worlds)
        return cls(np.frombuffer(payload, "<u8", num_worlds, _HEAD.size), actions, parameters)


def _read_parameters(text: bytes, num_worlds: int) -> Parameters:
    try:
        value = parse_json(text)
    except ValueError as error:
        raise ProtocolError(f"parameters of RESET are not JSON: {error}") from error
    given = cast(list[Any], value) if isinstance(value, list) else [value] * num_worlds
    if len(given) != num_worlds or not all(
        item is None or isinstance(item, dict) for item in given
    ):
        raise ProtocolError(
            "parameters of RESET must be null, an object or a list of these, one per world"
        )
    return cast(Parameters, value)
