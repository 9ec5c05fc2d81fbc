"""Python reads and writes every golden frame."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from ludus.spec import PolicySpec
from ludus.spec.batch import Batch, Batches
from ludus.wire.frames import FrameType, decode_json
from ludus.wire.handshake import EngineConfig, Hello, welcome
from ludus.wire.proof import Role, make_proof
from ludus.wire.spec_reader import read_spec
from ludus.wire.step import BatchDecoder
from tests.wire import reference
from tests.wire.golden import FOLDER, Golden, load, load_all
from tests.wire.stream import cut_frames

ALL = load_all()


def by_name(golden: Golden) -> str:
    return golden.name


def of_types(*types: FrameType) -> Callable[[Callable[..., None]], Callable[..., None]]:
    return pytest.mark.parametrize("golden", load_all(*types), ids=by_name)


def decoded_batch(golden: Golden) -> tuple[BatchDecoder, Batches]:
    decoder = BatchDecoder(golden.spec)
    frame = golden.frame
    decoder.buffer[: len(frame)] = frame
    return decoder, decoder.decode(len(frame) - 8)


def test_every_type_has_a_golden_frame() -> None:
    assert {golden.type for golden in ALL} == set(FrameType)


def test_every_frame_has_a_description_and_bytes() -> None:
    described = {path.stem for path in FOLDER.glob("*.json")}
    assert {path.stem for path in FOLDER.glob("*.bin")} == described


@pytest.mark.parametrize("golden", ALL, ids=by_name)
def test_encoding_gives_the_golden_bytes(golden: Golden) -> None:
    assert golden.encode() == golden.frame


@pytest.mark.parametrize("golden", ALL, ids=by_name)
def test_header_is_read(golden: Golden) -> None:
    assert list(cut_frames(golden.frame)) == [(golden.type, golden.payload)]


@of_types(
    FrameType.HELLO,
    FrameType.WELCOME,
    FrameType.SPEC,
    FrameType.CALL,
    FrameType.RESULT,
    FrameType.ERROR,
    FrameType.CHALLENGE,
    FrameType.PROOF,
)
def test_json_is_read(golden: Golden) -> None:
    assert decode_json(golden.payload, golden.name) == golden.content


@of_types(FrameType.SPEC)
def test_spec_is_read(golden: Golden) -> None:
    spec = read_spec(decode_json(golden.payload, "SPEC"))
    assert spec.to_json() == golden.content


@of_types(FrameType.HELLO)
def test_hello_is_read(golden: Golden) -> None:
    hello = Hello.from_json(decode_json(golden.payload, "HELLO"))
    content = golden.content
    assert hello.protocol == (content["protocol"]["min"], content["protocol"]["max"])
    assert hello.engine == f"{content['engine']['name']} {content['engine']['version']}"
    assert hello.addon == content["addon"]
    assert hello.capabilities == set(content["capabilities"])
    assert hello.nonce == content.get("nonce", "")
    assert hello.agree() == content["protocol"]["max"]


def test_welcome_has_the_keys_of_the_protocol() -> None:
    golden = load("welcome").content
    hello = Hello.from_json({**load("hello").content, "capabilities": ["rebuild", "call", "new"]})
    config = golden["config"]
    written = welcome(2, hello, EngineConfig(**config))
    assert written.keys() == golden.keys()
    assert written["capabilities"] == golden["capabilities"]
    assert written["config"] == config


@pytest.mark.parametrize("golden", [golden for golden in ALL if golden.token], ids=by_name)
def test_proofs_are_those_of_the_protocol(golden: Golden) -> None:
    nonces = load("hello").content["nonce"], load("challenge").content["nonce"]
    role: Role = "engine" if golden.type is FrameType.PROOF else "trainer"
    proof = make_proof(golden.token, role, *nonces)
    assert proof == golden.content["proof"]
    assert proof == reference.make_proof(golden.token, role, *nonces)


@of_types(FrameType.RESET)
def test_reset_is_read_by_the_reference(golden: Golden) -> None:
    assert reference.decode_reset(golden.payload) == golden.content


@of_types(FrameType.STEP)
def test_step_is_read_by_the_reference(golden: Golden) -> None:
    assert reference.decode_step(golden.spec_json, golden.payload) == golden.content


@of_types(FrameType.STEP)
def test_step_is_written_by_the_reference(golden: Golden) -> None:
    assert reference.encode_step(golden.spec_json, golden.content) == golden.payload


@of_types(FrameType.BATCH)
def test_batch_head_is_read(golden: Golden) -> None:
    decoder, _ = decoded_batch(golden)
    for name in ("tick", "engine_us", "bridge_us", "wait_us"):
        assert getattr(decoder.times, name) == golden.content[name]
    assert decoder.is_reset is golden.content["is_reset"]
    assert decoder.has_requests is golden.content["has_requests"]


@of_types(FrameType.BATCH)
def test_batch_is_read(golden: Golden) -> None:
    _, batches = decoded_batch(golden)
    assert list(batches) == [policy.name for policy in golden.spec.policies]
    for policy in golden.spec.policies:
        assert described(batches[policy.name], policy) == golden.content["policies"][policy.name]


def described(batch: Batch, policy: PolicySpec) -> dict[str, Any]:
    content: dict[str, Any] = {
        "observation": {name: values.tolist() for name, values in batch.observation.items()},
        "reward": batch.reward.tolist(),
        "terminated": batch.terminated.astype(int).tolist(),
        "truncated": batch.truncated.astype(int).tolist(),
        "active": batch.active.astype(int).tolist(),
        "final": {
            "slots": batch.final_index.tolist(),
            "observation": {n: values.tolist() for n, values in batch.final_observation.items()},
        },
    }
    if batch.action_mask is not None:
        content["action_mask"] = batch.action_mask.astype(int).tolist()
    for entry in policy.observation:
        assert batch.observation[entry.name].dtype == np.dtype(entry.dtype)
    return content


def test_descriptions_are_readable() -> None:
    for path in FOLDER.glob("*.json"):
        text = path.read_text(encoding="utf-8")
        assert json.loads(text)["about"].endswith("."), path.name
        assert "\t" not in text
