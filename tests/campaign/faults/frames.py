"""Golden frames with other bytes, cut, spliced, or with odd values: only named errors come out."""

from __future__ import annotations

import contextlib
import copy
import json
import random
from collections.abc import Callable
from functools import cache
from typing import Any, cast

from ludus.errors import EngineStartError, GameError, ProtocolError
from ludus.spec.finite import check_finite
from ludus.wire.frames import HEADER_BYTES, FrameType, decode_json, encode_frame
from ludus.wire.greeting import Greeting
from ludus.wire.requests import read_requests, split_metrics
from ludus.wire.spec_reader import read_spec
from ludus.wire.step import BatchDecoder
from ludus.wire.training import read_training
from tests.campaign.rounds import Finding, Round
from tests.wire.golden import Golden, load_all
from tests.wire.stream import cut_frames

__all__ = ["fuzz_frames", "mutate", "read_stream"]

FRAMES_PER_ROUND = 100_000
DOCUMENTED = (ProtocolError, EngineStartError, GameError)
"""What an engine that breaks the rules may cause; a game error if it sends NaN or infinity."""
ODD: list[Any] = [0, -1, 1.5, 2**31, 2**64, 10**300, -0.0, float("inf"), None, True, "", "\ud800",
                  "x" * 300, [], [[]], {}, [None]]  # fmt: skip


def fuzz_frames(the_round: Round, read: Callable[[bytes], None] | None = None) -> None:
    """Read many such frames, in this process, as a trainer reads what an engine sends."""
    reader = read or read_stream
    seed = the_round.chance.getrandbits(64)
    the_round.decide(f"{FRAMES_PER_ROUND} frames from seed {seed}")
    chance = random.Random(seed)
    golden = load_goldens()
    for number in range(FRAMES_PER_ROUND):
        data = mutate(golden, chance)
        try:
            reader(data)
        except DOCUMENTED:
            pass
        except Exception as error:
            what = f"{type(error).__name__}: {error}"
            raise Finding(f"frame {number} ({data[:200].hex()}…) raised {what}") from error
    the_round.counts["frames"] += FRAMES_PER_ROUND


@cache
def load_goldens() -> list[Golden]:
    """Return the golden frames that an engine may send."""
    ours = {FrameType.CHALLENGE, FrameType.WELCOME, FrameType.RESET, FrameType.STEP}
    return [golden for golden in load_all() if golden.type not in ours]


@cache
def _content(golden: str) -> tuple[bytes, FrameType, Any]:
    found = next(one for one in load_goldens() if one.name == golden)
    return found.frame, found.type, found.content


def mutate(golden: list[Golden], chance: random.Random) -> bytes:
    """Return a frame that is almost one of the golden ones."""
    frame, frame_type, content = _content(chance.choice(golden).name)
    kind = chance.randrange(4)
    if kind == 0 and frame[HEADER_BYTES : HEADER_BYTES + 1] == b"{":
        text = json.dumps(_put_odd(content, chance)).replace("Infinity", "1e999")
        return encode_frame(frame_type, text.encode())
    if kind == 1:
        other, *_ = _content(chance.choice(golden).name)
        data = frame[: chance.randint(0, len(frame))] + other[chance.randint(0, len(other)) :]
        return encode_frame(frame_type, data[HEADER_BYTES:]) if chance.random() < 0.5 else data
    data = bytearray(frame)
    # Mostly behind the header, where frames get past the first check.
    low = 0 if chance.random() < 0.2 or len(data) == HEADER_BYTES else HEADER_BYTES
    for _ in range(chance.randint(1, 4)):
        data[chance.randrange(low, len(data))] = chance.choice([0, 1, 255, chance.randrange(256)])
    return bytes(data)


def _put_odd(value: Any, chance: random.Random) -> Any:
    """Return a JSON value with an odd one somewhere inside."""
    if not value or not isinstance(value, dict | list) or chance.random() < 0.1:
        return chance.choice(ODD)
    changed: Any = copy.copy(cast(Any, value))
    keys: list[Any] = sorted(changed) if isinstance(value, dict) else list(range(len(changed)))
    key = chance.choice(keys)
    changed[key] = _put_odd(changed[key], chance)
    return changed


@cache
def _decoders() -> list[tuple[BatchDecoder, dict[str, Any]]]:
    specs = [golden.spec for golden in load_goldens() if golden.type is FrameType.BATCH]
    return [(BatchDecoder(spec), {one.name: one for one in spec.policies}) for spec in specs]


def read_stream(data: bytes) -> None:
    """Read the frames in ``data`` as a session does.

    Raises:
        ProtocolError: A header is not allowed.
    """
    for frame in cut_frames(data):
        with contextlib.suppress(*DOCUMENTED):
            _read_frame(frame.type, frame.payload)


def _read_frame(frame_type: FrameType, payload: bytes) -> None:
    match frame_type:
        case FrameType.HELLO:
            hello = _greet(payload).hello
            if hello is not None and hello.training is not None:
                read_training(hello.training)
        case FrameType.PROOF:
            greeting = _greet(next(one.payload for one in load_goldens() if one.name == "hello"))
            greeting.answer(frame_type, payload)
        case FrameType.SPEC:
            BatchDecoder(read_spec(decode_json(payload, "SPEC")))
        case FrameType.RESULT:
            value = decode_json(payload, "RESULT").get("value")
            if isinstance(value, list):
                split_metrics(read_requests(value))
        case FrameType.BATCH:
            for decoder, policies in _decoders():
                with contextlib.suppress(*DOCUMENTED):
                    _read_batch(decoder, policies, payload)
        case FrameType.PING | FrameType.PONG | FrameType.CLOSE | FrameType.RESET | FrameType.STEP:
            pass
        case _:
            decode_json(payload, frame_type.name)


def _greet(payload: bytes) -> Greeting:
    greeting = Greeting("a secret of the campaign", takes_protocol_1=True)
    greeting.state.receive(FrameType.HELLO)
    greeting.answer(FrameType.HELLO, payload)
    return greeting


def _read_batch(decoder: BatchDecoder, policies: dict[str, Any], payload: bytes) -> None:
    end = HEADER_BYTES + len(payload)
    if end <= len(decoder.buffer):
        decoder.buffer[HEADER_BYTES:end] = payload
        batches = decoder.decode(len(payload))
        if not decoder.all_finite_fast():
            check_finite(policies, batches, 0)
