"""The engine written from PROTOCOL.md alone passes the conformance kit, and is learned."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import pytest
from tests.protocol import reference_engine
from tests.protocol.reference_engine import Outcome

from ludus.check import CheckConfig, Status, run_checks
from ludus.settings.train_config import TrainConfig
from ludus.training.loop import train

ENGINE = Path(reference_engine.__file__)
GOLDEN = Path(__file__).parents[2] / "protocol" / "golden"


def golden(name: str) -> tuple[bytes, dict[str, Any]]:
    """Return the payload of a golden frame, and what it carries."""
    content = json.loads((GOLDEN / f"{name}.json").read_text(encoding="utf-8"))["content"]
    return (GOLDEN / f"{name}.bin").read_bytes()[reference_engine.HEADER.size :], content


def _frames(frame: str) -> list[str]:
    described = {path.stem: json.loads(path.read_text()) for path in sorted(GOLDEN.glob("*.json"))}
    return [name for name, content in described.items() if content["frame"] == frame]


@pytest.mark.parametrize("name", [n for n in _frames("BATCH") if "_flat_" in n])
def test_batches_are_written_as_golden(name: str) -> None:
    _, content = golden(name)
    cart = content["policies"]["cart"]
    finals = dict(
        zip(cart["final"]["slots"], cart["final"]["observation"]["observation"], strict=True)
    )
    rows = zip(cart["reward"], cart["terminated"], cart["truncated"], strict=True)
    outcomes = [cast(Outcome, (*row, finals.get(slot))) for slot, row in enumerate(rows)]
    frame = reference_engine.encode_batch(
        content["tick"],
        (content["engine_us"], content["bridge_us"], content["wait_us"]),
        content["is_reset"] + 2 * content["has_requests"],
        cart["observation"]["observation"],
        outcomes,
    )
    assert frame == (GOLDEN / f"{name}.bin").read_bytes()


@pytest.mark.parametrize("name", _frames("RESET"))
def test_resets_are_read_as_golden(name: str) -> None:
    payload, content = golden(name)
    num = len(content["seeds"])
    seeds, actions, parameters = reference_engine.decode_reset(payload, num)
    own = content["parameters"]
    assert seeds == [int(seed, 16) for seed in content["seeds"]]
    assert actions == content["actions"]
    assert parameters == (own if isinstance(own, list) else [own] * num)


def test_steps_are_read_as_golden() -> None:
    payload, content = golden("step_flat")
    choices = [row[0] for row in content["policies"]["cart"]["discrete"]]
    assert reference_engine.decode_step(payload, len(choices)) == choices


@pytest.mark.parametrize("frame", ["HELLO", "WELCOME", "SPEC", "CALL", "RESULT", "ERROR"])
def test_json_is_read_as_golden(frame: str) -> None:
    for name in _frames(frame):
        payload, content = golden(name)
        assert reference_engine.decode_json(payload) == content


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The engine as a program that this very Python runs."""
    path = tmp_path_factory.mktemp("engine") / "line"
    path.write_text(f"#!{sys.executable}\n" + ENGINE.read_text(encoding="utf-8"))
    path.chmod(0o755)
    return path


def _failures(target: str | Path) -> list[str]:
    config = CheckConfig(target=target, num_steps=100, num_layout_worlds=4, timing_s=0.05)
    report = run_checks(config)
    assert len(report.findings) > 20
    return [f"{f.title}: {f.detail}" for _, f in report.findings if f.status is Status.FAIL]


@pytest.mark.engine
def test_its_program_passes_the_checks(program: Path) -> None:
    assert _failures(program) == []


@pytest.fixture
def listening(program: Path) -> Iterator[str]:
    """The address of an engine that listens."""
    command = [program, "--ludus-listen=tcp:127.0.0.1:0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=os.environ) as process:
        assert process.stdout is not None
        yield process.stdout.readline().removeprefix("listening at ").strip()
        assert process.wait(30) == 0


@pytest.mark.engine
def test_it_passes_the_checks_where_it_listens(listening: str) -> None:
    assert _failures(listening) == []


@pytest.mark.engine
@pytest.mark.slow
def test_it_is_learned(program: Path, tmp_path: Path) -> None:
    shutil.copy(program, tmp_path / "walker")
    config = TrainConfig(
        target=str(tmp_path / "walker"),
        runs=tmp_path / "runs",
        num_worlds=32,
        num_engines=1,
        total_steps=40_000,
        evaluation_episodes=10,
        seed=1,
    )
    result = train(config)
    # Straight to the goal, from 0 to 4 places away from the start: 1 - 0.01 x (4 to 8 steps).
    assert result.evaluation["walker"].mean_return > 0.9
