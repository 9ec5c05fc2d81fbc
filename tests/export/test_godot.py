"""The add-ons' inference in both real Godots computes what PyTorch computes."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import pytest
import torch

from ludus.engine import EngineKind, InstalledEngine, find_engine
from ludus.errors import EngineError, EngineTimeout, ParityError
from ludus.export import engines as engine_runtimes
from ludus.export.convert import to_model
from ludus.export.engines import REQUEST
from ludus.export.parity import (
    ParityReport,
    PolicyFiles,
    measure_parity,
    require_parity,
)
from ludus.model.json_file import write_model
from ludus.networks.policy import Policy
from ludus.settings.train_config import PolicyConfig, PPOConfig, SACConfig
from ludus.spec import ObservationEntry, PolicySpec
from tests.export.trained_runs import MIXED, SIMPLE, make_policy
from tests.legacy.gymgodot.conftest import command_of, started_processes

pytestmark = pytest.mark.engine

ATARI = dataclasses.replace(
    SIMPLE, observation=(ObservationEntry("camera", "uint8", (4, 84, 84, 1), 0, 255),)
)


@pytest.fixture(params=[EngineKind.GODOT4, EngineKind.GODOT3], ids=str)
def godot(request: pytest.FixtureRequest) -> InstalledEngine:
    return find_engine(request.param)


def engines() -> list[int]:
    """Return the ids of the parity tests in Godot that we have started."""
    scripts = {str(engine_runtimes.SCRIPT), str(engine_runtimes.SCRIPT3)}
    return [
        process.pid
        for process in started_processes()
        if not scripts.isdisjoint(command_of(process))
    ]


def measure(policy: Policy, folder: Path, engine: InstalledEngine) -> ParityReport:
    model = to_model(policy, policy.spec)
    path = folder / "policy.ludus.json"
    write_model(path, model)
    return measure_parity(policy, model, PolicyFiles(path), engine, {})


@pytest.mark.parametrize(
    ("spec", "config"),
    [
        (SIMPLE, PPOConfig(hidden_sizes=(64, 64))),
        (MIXED, PPOConfig(hidden_sizes=(16, 7), activation="elu", squash=True)),
        (MIXED, PPOConfig(hidden_sizes=(9,), memory_size=7, state_dependent_std=True)),
        (MIXED, PPOConfig(hidden_sizes=(9,), memory_size=5, frame_stack=3)),
        (MIXED, SACConfig(hidden_sizes=(16,), activation="silu", normalise_observation=False)),
        (ATARI, PPOConfig(hidden_sizes=(16,), activation="relu")),
    ],
    ids=["simple", "mixed", "memory", "frames", "sac", "atari"],
)
def test_godot_computes_the_same(
    spec: PolicySpec, config: PolicyConfig, godot: InstalledEngine, tmp_path: Path
) -> None:
    report = measure(make_policy(spec, config, noise=0.01), tmp_path, godot)
    require_parity(report)
    comparison = report.comparisons[-1]
    assert comparison.runtime.startswith(f"Godot {godot.version[0]}.")
    assert 0 < comparison.outputs <= 1e-4
    assert engines() == []


def test_godot_notices_an_altered_weight(godot: InstalledEngine, tmp_path: Path) -> None:
    policy = make_policy(SIMPLE)
    model = to_model(policy, SIMPLE)
    path = tmp_path / "policy.ludus.json"
    write_model(path, model)
    with torch.no_grad():
        next(iter(policy.actor.parameters()))[0, 0] += 0.05
    report = measure_parity(policy, model, PolicyFiles(path), godot, {})
    assert not report.comparisons[-1].is_equal
    godot_alone = dataclasses.replace(report, comparisons=report.comparisons[-1:])
    with pytest.raises(ParityError, match=r"policy hero: Godot [34]\.\S+ differs from PyTorch by"):
        require_parity(godot_alone)


def test_a_file_that_godot_refuses_is_an_error(
    godot: InstalledEngine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    policy = make_policy(SIMPLE)
    monkeypatch.setattr(engine_runtimes, "write_request", write_broken_request)
    with pytest.raises(EngineError, match="does not run in Godot") as error:
        measure(policy, tmp_path, godot)
    assert "is not JSON" in error.value.message
    assert "--no-parity" in error.value.hint
    assert engines() == []


def write_broken_request(folder: Path, path: Path, *_: object) -> None:
    broken = folder / "broken.ludus.json"
    broken.write_text("{")
    request: dict[str, Any] = {
        "policy": str(broken), "num_steps": 1, "num_agents": 1, "entries": [], "mask_size": 0,
    }  # fmt: skip
    (folder / REQUEST).write_text(json.dumps(request))


def test_an_engine_that_takes_too_long_is_ended(
    godot: InstalledEngine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The real engine, which somebody stops before it can begin."""
    stopped = tmp_path / "stopped"
    program = godot.executable(headless=True)
    stopped.write_text(f'#!/bin/sh\nkill -STOP $$\nexec "{program}" "$@"\n')
    stopped.chmod(0o755)
    monkeypatch.setattr(engine_runtimes, "TIMEOUT_S", 0.5)
    with pytest.raises(EngineTimeout, match="did not test the policy within") as error:
        measure(make_policy(SIMPLE), tmp_path, dataclasses.replace(godot, path=stopped))
    assert "--no-parity" in error.value.hint
    assert engines() == []
