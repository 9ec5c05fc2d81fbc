"""The engine's side of PROTOCOL.md §5 to §7, written from that page alone.

It shares no code with ``ludus``, so that a mistake there cannot hide here. Specs and contents are
the plain JSON values of ``protocol/golden``.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import struct
from collections.abc import Iterator
from typing import Any, cast

Json = dict[str, Any]

CODES = {"float32": "f", "uint8": "B", "int64": "q"}
FRAME_NUMBERS = {
    "HELLO": 1,
    "WELCOME": 2,
    "SPEC": 3,
    "RESET": 4,
    "STEP": 5,
    "BATCH": 6,
    "CALL": 7,
    "RESULT": 8,
    "PING": 9,
    "PONG": 10,
    "ERROR": 11,
    "CLOSE": 12,
    "CHALLENGE": 13,
    "PROOF": 14,
}


def frame(name: str, payload: bytes) -> bytes:
    """Return a whole frame (§1)."""
    return struct.pack("<IBBH", len(payload), FRAME_NUMBERS[name], 0, 0) + payload


def json_frame(name: str, value: Any) -> bytes:
    return frame(name, json.dumps(value).encode())


def pad(data: bytes) -> bytes:
    return data + bytes(-len(data) % 8)


def _flatten(value: Any) -> Iterator[Any]:
    if isinstance(value, list):
        for item in cast(list[Any], value):
            yield from _flatten(item)
    else:
        yield value


def _array(code: str, value: Any) -> bytes:
    numbers = list(_flatten(value))
    return pad(struct.pack(f"<{len(numbers)}{code}", *numbers))


def _nested(numbers: list[Any], shape: list[int]) -> list[Any]:
    if len(shape) == 1:
        return numbers
    size = len(numbers) // shape[0] if shape[0] else 0
    return [_nested(numbers[i * size : (i + 1) * size], shape[1:]) for i in range(shape[0])]


class _Cursor:
    """Reads arrays one after the other."""

    def __init__(self, payload: bytes) -> None:
        self.payload = payload
        self.offset = 0

    def numbers(self, code: str, count: int) -> list[Any]:
        layout = struct.Struct(f"<{count}{code}")
        values = list(layout.unpack_from(self.payload, self.offset))
        padding = -layout.size % 8
        end = self.offset + layout.size + padding
        assert self.payload[end - padding : end] == bytes(padding), "padding is not zero"
        self.offset = end
        return values

    def array(self, code: str, shape: list[int]) -> list[Any]:
        count = 1
        for length in shape:
            count *= length
        return _nested(self.numbers(code, count), shape)

    def end(self) -> None:
        assert self.offset == len(self.payload), "bytes too many"


def action_sizes(policy: Json) -> tuple[int, int]:
    """Return the number of discrete components and of continuous elements."""
    choices = [part for part in policy["action"] if part["kind"] == "discrete"]
    sizes = [part["size"] for part in policy["action"] if part["kind"] == "continuous"]
    return len(choices), sum(sizes)


def mask_size(policy: Json) -> int:
    choices = [part["n"] for part in policy["action"] if part["kind"] == "discrete"]
    return sum(choices) if policy["has_action_mask"] else 0


def encode_step(spec: Json, content: Json) -> bytes:
    """Return the payload of a ``STEP`` (§6)."""
    payload = b""
    for policy in spec["policies"]:
        actions = content["policies"][policy["name"]]
        payload += _array("q", actions["discrete"]) + _array("f", actions["continuous"])
    return payload


def decode_step(spec: Json, payload: bytes) -> Json:
    """Read the payload of a ``STEP`` (§6)."""
    cursor = _Cursor(payload)
    policies: Json = {}
    for policy in spec["policies"]:
        num = policy["num_agents"]
        choices, size = action_sizes(policy)
        policies[policy["name"]] = {
            "discrete": cursor.array("q", [num, choices]) if choices else [],
            "continuous": cursor.array("f", [num, size]) if size else [],
        }
    cursor.end()
    return {"policies": policies}


def encode_batch(spec: Json, content: Json) -> bytes:
    """Return the payload of a ``BATCH`` (§7)."""
    times = [content[name] for name in ("tick", "engine_us", "bridge_us", "wait_us")]
    flags = int(content["is_reset"]) | int(content["has_requests"]) << 1
    payload = struct.pack("<QIIII", *times, flags)
    for policy in spec["policies"]:
        part = content["policies"][policy["name"]]
        for entry in policy["observation"]:
            payload += _array(CODES[entry["dtype"]], part["observation"][entry["name"]])
        payload += _array("f", part["reward"])
        for outcome in ("terminated", "truncated", "active"):
            payload += _array("B", part[outcome])
        if policy["has_action_mask"]:
            payload += _array("B", part["action_mask"])
    for policy in spec["policies"]:
        payload += _encode_final(policy, content["policies"][policy["name"]]["final"])
    return payload


def _encode_final(policy: Json, final: Json) -> bytes:
    payload = struct.pack("<II", len(final["slots"]), 0) + _array("I", final["slots"])
    for entry in policy["observation"]:
        payload += _array(CODES[entry["dtype"]], final["observation"][entry["name"]])
    return payload


def decode_reset(payload: bytes) -> Json:
    """Read the payload of a ``RESET`` (§5); seeds as 16 hexadecimal digits."""
    num_worlds, num_text = struct.unpack_from("<II", payload)
    middle = 8 + num_worlds * 8
    seeds = struct.unpack_from(f"<{num_worlds}Q", payload, 8)
    text = payload[middle + num_worlds + (-num_worlds % 8) :]
    assert len(text) == num_text
    return {
        "seeds": [f"{seed:016x}" for seed in seeds],
        "actions": list(payload[middle : middle + num_worlds]),
        "parameters": json.loads(text),
    }


def quiet_batch(spec: Json, *, is_reset: bool = False, value: float = 0.0) -> Json:
    """Return the content of a ``BATCH`` in which nothing ends and every entry is ``value``."""
    return {
        "tick": 0,
        "engine_us": 0,
        "bridge_us": 0,
        "wait_us": 0,
        "is_reset": is_reset,
        "has_requests": False,
        "policies": {policy["name"]: _quiet_policy(policy, value) for policy in spec["policies"]},
    }


def _quiet_policy(policy: Json, value: float) -> Json:
    num = policy["num_agents"]
    return {
        "observation": {
            entry["name"]: _filled(entry, [num, *entry["shape"]], value)
            for entry in policy["observation"]
        },
        "reward": [0.0] * num,
        "terminated": [0] * num,
        "truncated": [0] * num,
        "active": [1] * num,
        "action_mask": [[1] * mask_size(policy)] * num,
        "final": {"slots": [], "observation": {e["name"]: [] for e in policy["observation"]}},
    }


def _filled(entry: Json, shape: list[int], value: float) -> list[Any]:
    number = value if entry["dtype"] == "float32" else int(value)
    if len(shape) == 1:
        return [number] * shape[0]
    return [_filled(entry, shape[1:], value) for _ in range(shape[0])]


def make_proof(token: str, role: str, engine_nonce: str, trainer_nonce: str) -> str:
    """Return the proof of §3, by the definition of HMAC."""
    message = f"ludus 2 {role}".encode() + bytes.fromhex(engine_nonce + trainer_nonce)
    return hmac.digest(token.encode(), message, hashlib.sha256).hex()
