"""The golden frames of ``protocol/golden``: find them, describe them, write them anew.

``python -m tests.wire.golden`` writes every ``.bin`` from the ``.json`` beside it. Frames that a
trainer sends come from ``ludus`` itself, frames that an engine sends from the reference.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ludus.spec import PolicySpec, Spec
from ludus.spec.batch import ActionBatch
from ludus.wire.frames import FrameType, encode_frame, encode_json
from ludus.wire.reset import ResetRequest
from ludus.wire.spec_reader import read_spec
from ludus.wire.step import StepEncoder
from tests.wire import reference

FOLDER = Path(__file__).resolve().parents[2] / "protocol" / "golden"


@dataclass(frozen=True)
class Golden:
    """One golden frame.

    Attributes:
        name: File name without suffix.
        type: Frame type.
        content: What it carries; see ``protocol/golden/README.md``.
        spec_json: The spec that ``STEP`` and ``BATCH`` belong to.
        token: The token that ``CHALLENGE``, ``PROOF`` and ``error_refused`` prove.
    """

    name: str
    type: FrameType
    content: dict[str, Any]
    spec_json: dict[str, Any]
    token: str = ""

    @property
    def path(self) -> Path:
        return FOLDER / f"{self.name}.bin"

    @property
    def frame(self) -> bytes:
        return self.path.read_bytes()

    @property
    def payload(self) -> bytes:
        return self.frame[8:]

    @property
    def spec(self) -> Spec:
        return read_spec(self.spec_json)

    def encode(self) -> bytes:
        """Return the frame that the description asks for."""
        match self.type:
            case FrameType.RESET:
                return reset_request(self.content).encode()
            case FrameType.STEP:
                return bytes(StepEncoder(self.spec).encode(actions(self.spec, self.content)))
            case FrameType.BATCH:
                payload = reference.encode_batch(self.spec_json, self.content)
                return encode_frame(FrameType.BATCH, payload)
            case FrameType.PING | FrameType.PONG | FrameType.CLOSE:
                return encode_frame(self.type, bytes.fromhex(self.content["payload_hex"]))
            case _:
                return encode_json(self.type, self.content)


def load(name: str) -> Golden:
    """Return one golden frame."""
    described = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    spec = described.get("spec")
    return Golden(
        name=name,
        type=FrameType[described["frame"]],
        content=described["content"],
        spec_json=load(spec).content if spec else {},
        token=described.get("token", ""),
    )


def load_all(*types: FrameType) -> list[Golden]:
    """Return the golden frames of some types (none named: of all), by name."""
    frames = [load(path.stem) for path in sorted(FOLDER.glob("*.json"))]
    return [frame for frame in frames if not types or frame.type in types]


def reset_request(content: dict[str, Any]) -> ResetRequest:
    """Return the request that a described ``RESET`` carries."""
    seeds = np.array([int(seed, 16) for seed in content["seeds"]], np.uint64)
    return ResetRequest(seeds, np.array(content["actions"], np.uint8), content["parameters"])


def actions(spec: Spec, content: dict[str, Any]) -> dict[str, ActionBatch]:
    """Return the actions that a described ``STEP`` carries."""
    return {
        policy.name: _policy_actions(policy, content["policies"][policy.name])
        for policy in spec.policies
    }


def _policy_actions(policy: PolicySpec, content: dict[str, Any]) -> ActionBatch:
    num = policy.num_agents
    return ActionBatch(
        np.array(content["discrete"], np.int64).reshape(num, policy.num_discrete),
        np.array(content["continuous"], np.float32).reshape(num, policy.continuous_size),
    )


def write_all() -> int:
    """Write every golden frame; returns how many."""
    frames = load_all()
    for golden in frames:
        golden.path.write_bytes(golden.encode())
    return len(frames)


if __name__ == "__main__":
    sys.stdout.write(f"{write_all()} golden frames written to {FOLDER}\n")
