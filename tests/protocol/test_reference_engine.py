"""PROTOCOL.md is enough to write an engine: the reference engine passes, trains, and ends."""

from __future__ import annotations

import contextlib
import json
import math
import socket
import subprocess
import sys
from collections.abc import Generator
from pathlib import Path
from typing import Any, cast

import psutil
import pytest

from ludus import PoolConfig, TrainConfig, open_pool, train
from ludus.check import CheckConfig, CheckReport, Status, run_checks
from ludus.errors import LudusError
from ludus.link import Link, LinkClosed
from tests.protocol import reference_engine as engine

GOLDEN = Path(__file__).parents[2] / "protocol" / "golden"
PROGRAM = Path(engine.__file__)
READ = ("CHALLENGE", "WELCOME", "RESET", "STEP", "CALL", "PING", "ERROR", "CLOSE")
WRITTEN = ("HELLO", "PROOF", "SPEC", "BATCH", "RESULT", "PONG", "ERROR", "CLOSE")


def golden(types: tuple[str, ...]) -> list[Any]:
    """The golden frames of these types, as parameters of a test."""
    files = sorted(GOLDEN.glob("*.json"))
    frames = [(file.stem, json.loads(file.read_text())) for file in files]
    return [pytest.param(name, it, id=name) for name, it in frames if it["frame"] in types]


def layouts_of(name: str) -> list[engine.Layout]:
    spec = json.loads((GOLDEN / f"{name}.json").read_text())["content"]
    return [engine.Layout.of(policy) for policy in spec["policies"]]


def flat(value: Any) -> list[Any]:
    parts = cast(list[Any], value) if isinstance(value, list) else None
    return [value] if parts is None else [number for part in parts for number in flat(part)]


def test_every_type_of_frame_is_read_or_written() -> None:
    types = {json.loads(file.read_text())["frame"] for file in GOLDEN.glob("*.json")}
    assert types == {*READ, *WRITTEN}


@pytest.mark.parametrize(("name", "said"), golden(READ))
def test_golden_frame_is_read(name: str, said: dict[str, Any]) -> None:
    frame = (GOLDEN / f"{name}.bin").read_bytes()
    payload_bytes, frame_type = engine.parse_header(frame[: engine.HEADER.size])
    payload = frame[engine.HEADER.size :]
    assert frame_type == getattr(engine, said["frame"])
    assert payload_bytes == len(payload)
    content = said["content"]
    if frame_type == engine.RESET:
        request = engine.parse_reset(payload)
        assert request.seeds == [int(seed, 16) for seed in content["seeds"]]
        assert (request.actions, request.parameters) == (content["actions"], content["parameters"])
    elif frame_type == engine.STEP:
        chosen = engine.parse_step(layouts_of(said["spec"]), payload)
        assert list(chosen) == list(content["policies"])
        for policy, (discrete, continuous) in chosen.items():
            wanted = content["policies"][policy]
            # Components of which there are none leave an empty row per slot here.
            assert [row for row in discrete if row] == wanted["discrete"]
            assert [row for row in continuous if row] == wanted["continuous"]
    elif frame_type in (engine.PING, engine.CLOSE):
        assert payload.hex() == content["payload_hex"]
    else:
        assert engine.parse_json(payload) == content


def test_golden_proofs_are_made() -> None:
    hello, challenge, refusal, proof = (
        json.loads((GOLDEN / f"{name}.json").read_text())
        for name in ("hello", "challenge", "error_refused", "proof")
    )
    nonces = hello["content"]["nonce"], challenge["content"]["nonce"]
    for side, frame in (("trainer", challenge), ("trainer", refusal), ("engine", proof)):
        made = engine.make_proof(frame["token"], side, *nonces)
        assert made == frame["content"]["proof"]


@pytest.mark.parametrize(("name", "said"), golden(WRITTEN))
def test_golden_frame_is_written(name: str, said: dict[str, Any]) -> None:
    expected = (GOLDEN / f"{name}.bin").read_bytes()
    frame_type, content = getattr(engine, said["frame"]), said["content"]
    if frame_type == engine.BATCH:
        head = [content[key] for key in ("tick", "engine_us", "bridge_us", "wait_us")]
        flags = content["is_reset"] + 2 * content["has_requests"]
        layouts = layouts_of(said["spec"])
        batches = [policy_batch(content["policies"][layout.name]) for layout in layouts]
        assert engine.pack_batch((*head, flags), layouts, batches) == expected
    elif "payload_hex" in content:
        payload = bytes.fromhex(content["payload_hex"])
        assert engine.pack_frame(frame_type, payload) == expected
    else:
        # Other JSON payloads are compared as values: languages write `60.0` and `60`.
        written = engine.pack_json(frame_type, content)
        assert written[4 : engine.HEADER.size] == expected[4 : engine.HEADER.size]
        assert json.loads(written[engine.HEADER.size :]) == json.loads(
            expected[engine.HEADER.size :]
        )


def policy_batch(content: dict[str, Any]) -> engine.PolicyBatch:
    def rows(arrays: dict[str, Any]) -> dict[str, engine.Rows]:
        return {name: [flat(row) for row in array] for name, array in arrays.items()}

    return engine.PolicyBatch(
        observation=rows(content["observation"]),
        reward=content["reward"],
        terminated=content["terminated"],
        truncated=content["truncated"],
        active=content["active"],
        action_mask=content.get("action_mask", []),
        final_slots=content["final"]["slots"],
        final_observation=rows(content["final"]["observation"]),
    )


def walkers() -> list[psutil.Process]:
    """Reference engines that this process has started and that still run."""
    children = psutil.Process().children(recursive=True)
    alive = [child for child in children if child.status() != psutil.STATUS_ZOMBIE]
    return [child for child in alive if str(PROGRAM) in child.cmdline()]


@contextlib.contextmanager
def listening(*arguments: str) -> Generator[tuple[str, subprocess.Popen[str]]]:
    """Start the engine as a listener; give its HOST:PORT and the process."""
    command = [sys.executable, str(PROGRAM), "--ludus-listen=tcp:127.0.0.1:0", *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            line = process.stdout.readline().strip()
            assert line.startswith("listening on tcp:"), line
            yield line.removeprefix("listening on tcp:"), process
        finally:
            process.kill()


def assert_passed(report: CheckReport) -> None:
    findings = [finding for _, finding in report.findings]
    assert [finding for finding in findings if finding.status in {Status.FAIL, Status.WARN}] == []
    assert sum(finding.status == Status.OK for finding in findings) >= 20


@pytest.mark.engine
def test_check_passes_on_the_program() -> None:
    config = CheckConfig(target=PROGRAM, num_steps=100, num_layout_worlds=8, timing_s=0.05)
    report = run_checks(config)
    assert_passed(report)
    # It has no grid, and says so.
    assert [finding.status for name, finding in report.findings if name == "layouts"] == [
        Status.INFO
    ]
    assert walkers() == []


@pytest.mark.engine
def test_check_passes_on_an_address_and_the_engine_quits() -> None:
    with listening() as (address, process):
        assert_passed(run_checks(CheckConfig(target=address, num_steps=100)))
        assert process.wait(timeout=10) == 0


@pytest.mark.engine
def test_strangers_keep_no_trainer_out() -> None:
    with listening() as (address, process), contextlib.ExitStack() as strangers:
        host, port = address.split(":")
        for said in (b"", b"GET / HTTP/1.1\r\n\r\n", engine.pack_json(engine.CHALLENGE, {})):
            stranger = strangers.enter_context(socket.create_connection((host, int(port))))
            stranger.sendall(said)
        with open_pool(address) as pool:
            pool.reset(seed=1)
        assert process.wait(timeout=10) == 0


@pytest.mark.engine
def test_only_the_trainer_can_refuse(tmp_path: Path) -> None:
    """An ERROR without its proof is a stranger's, which keeps no trainer out."""
    token, nonce = "a token that is long enough", "00" * 32
    (tmp_path / "token").write_text(token)
    with listening(f"--ludus-token-file={tmp_path / 'token'}") as (address, process):
        host, port = address.split(":")
        for known in ("", "another token, long as well", token):
            with socket.create_connection((host, int(port))) as client:
                link = Link(client, 10.0)
                hello = json.loads(link.receive()[1])
                report = {"code": "version", "message": "no"}
                if known:
                    report["nonce"] = nonce
                    report["proof"] = engine.make_proof(known, "trainer", hello["nonce"], nonce)
                link.send(engine.pack_json(engine.ERROR, report))
                if known != token:
                    with pytest.raises(LinkClosed):
                        link.receive()
                    assert process.poll() is None
        assert process.wait(timeout=10) == 1


@pytest.mark.engine
def test_a_trainer_with_another_token_is_refused(tmp_path: Path) -> None:
    (tmp_path / "ours").write_text("a token that is long enough")
    (tmp_path / "theirs").write_text("another token, long as well")
    with listening(f"--ludus-token-file={tmp_path / 'ours'}") as (address, process):
        with pytest.raises(LudusError, match="token"):
            open_pool(address, PoolConfig(token_file=tmp_path / "theirs"))
        with open_pool(address, PoolConfig(token_file=tmp_path / "ours")) as pool:
            pool.reset(seed=1)
        assert process.wait(timeout=10) == 0


@pytest.mark.engine
@pytest.mark.slow
def test_training_learns_the_shortest_way_to_the_goal(tmp_path: Path) -> None:
    config = TrainConfig(
        target=str(PROGRAM),
        total_steps=40_000,
        num_worlds=32,
        seed=1,
        runs=tmp_path,
        evaluation_episodes=100,
    )
    evaluation = train(config).evaluation["walker"]
    # A walker that never reaches the goal has -2.5.
    assert evaluation.mean_return > 0.95 * optimal_return()
    assert walkers() == []


def optimal_return() -> float:
    """The mean return of the shortest ways: from each inner place to the goal at an end."""
    distances = range(1, engine.Walker().length - 1)
    return math.fsum(1.0 - 0.05 * (steps - 1) for steps in distances) / len(distances)
