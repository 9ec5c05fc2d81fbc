"""The ``RESET`` payload (PROTOCOL.md §5). No input or output."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ludus.errors import UsageError
from ludus.wire.frames import FrameType, encode_frame, padded

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
        parameters: One mapping for all worlds that are reset, or a mapping or None per world.
    """

    seeds: NDArray[np.uint64]
    actions: NDArray[np.uint8]
    parameters: Parameters = None

    @classmethod
    def all_worlds(
        cls, num_worlds: int, seed: int | None, parameters: Parameters = None
    ) -> ResetRequest:
        """Reset every world: *i* gets ``seed + i``; with None each continues its random stream."""
        action = ResetAction.NEXT_EPISODE if seed is None else ResetAction.SEED
        seeds = [((seed or 0) + i) % (1 << 64) for i in range(num_worlds)]
        return cls(np.array(seeds, np.uint64), np.full(num_worlds, action, np.uint8), parameters)

    def encode(self) -> bytes:
        """Return the whole frame.

        Raises:
            UsageError: The parameters are not JSON, or not one per world.
        """
        num_worlds = len(self.seeds)
        parameters: Any = self.parameters
        if parameters is not None and not isinstance(parameters, Mapping):
            parameters = list(parameters)
            if len(parameters) != num_worlds:
                raise UsageError(f"parameters for {len(parameters)} worlds, there are {num_worlds}")
        try:
            text = json.dumps(parameters, separators=(",", ":"), allow_nan=False).encode()
        except (TypeError, ValueError) as error:
            raise UsageError(
                f"reset parameters must be JSON: {error}",
                hint="use numbers, strings, lists, and dictionaries with string keys",
            ) from error
        body = self.seeds.astype("<u8").tobytes() + self.actions.astype("u1").tobytes()
        body += bytes(padded(len(body)) - len(body))
        return encode_frame(FrameType.RESET, _HEAD.pack(num_worlds, len(text)) + body + text)
