from __future__ import annotations

import itertools
import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from ludus.errors import RunError
from ludus.runs.checkpoint import read_checkpoint
from ludus.runs.control import (
    SaveRequest,
    SetMode,
    StopRequest,
    read_request,
    send_request,
    take_requests,
)
from ludus.runs.metrics import read_metrics
from ludus.runs.run_folder import RunFolder
from ludus.settings.train_config import Phase
from ludus.training.loop import train
from ludus.training.progress import Progress, SilentReporter


def test_requests_are_taken_once_and_in_order(tmp_path: Path) -> None:
    folder = tmp_path / "control"
    assert take_requests(folder) == []
    sent = [SetMode("hero", "frozen"), SaveRequest(), StopRequest()]
    for request in sent:
        send_request(folder, request)
    taken = [read_request(values, ["hero"]) for values in take_requests(folder)]
    assert taken == sent
    assert take_requests(folder) == []


@pytest.mark.parametrize(
    "values",
    [
        {"kind": "set_mode", "policy": "foe", "mode": "frozen"},
        {"kind": "set_mode", "policy": "hero", "mode": "idle"},
        {"kind": "set_mode", "policy": ["hero"], "mode": "frozen"},
        {"kind": "set_mode"},
        {"kind": "explode"},
        {},
    ],
)
def test_what_is_unknown_is_left_out_with_a_warning(
    values: dict[str, Any], caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        assert read_request(values, ["hero"]) is None
    assert "unknown request" in caplog.text


@pytest.mark.parametrize("data", [b"", b"{", b"[1]", b"\xff", b'{"kind": "save"' + b" " * 5000])
def test_malformed_files_are_removed(
    data: bytes, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "1.json").write_bytes(data)
    send_request(tmp_path, StopRequest())
    with caplog.at_level(logging.WARNING):
        assert take_requests(tmp_path) == [{"kind": "stop"}]
    assert list(tmp_path.iterdir()) == []


class Asking(SilentReporter):
    """Leaves requests in the run's folder after given updates."""

    def __init__(self, run: Path, requests: dict[int, Any]) -> None:
        self._run, self._requests, self._updates = run, requests, 0

    def updated(self, progress: Progress) -> None:
        self._updates += 1
        for request in self._requests.get(self._updates, []):
            send_request(self._run / "control", request)


def test_requests_change_a_running_run(small: Any) -> None:
    config = small(total_steps=6_400, checkpoint_every_updates=None)
    run = config.runs / "run"
    requests = {
        3: [SetMode("agent", "frozen")],
        5: [SetMode("agent", "train"), SaveRequest()],
        8: [StopRequest()],
    }
    result = train(config, reporter=Asking(run, requests))
    assert (result.stop_reason, result.updates, result.signum) == ("stopped", 8, None)
    lines = [line["policies"]["agent"] for line in read_metrics(run / "metrics.jsonl")]
    assert [line["is_learning"] for line in lines] == [1, 1, 1, 0, 0, 1, 1, 1]
    assert ["policy_loss" in line for line in lines] == [True] * 3 + [False] * 2 + [True] * 3
    # While frozen, 32 steps pass between two looks at the requests instead of 8.
    saved = sorted(path.name for path in (run / "checkpoints").iterdir())
    steps = [0, 3 * 64 + 2 * 256, 6 * 64 + 2 * 256]
    assert saved == [f"step-{step:012d}" for step in steps]


def test_a_mode_that_changes_after_a_checkpoint_is_saved_with_it(small: Any) -> None:
    config = small(checkpoint_every_updates=1)
    run = config.runs / "run"
    requests = [SetMode("agent", "frozen"), SaveRequest(), StopRequest()]
    result = train(config, reporter=Asking(run, {2: requests}))
    assert (result.stop_reason, result.updates) == ("stopped", 2)
    *_, newest = RunFolder(run).checkpoints().paths()
    checkpoint = read_checkpoint(newest)
    assert checkpoint.run["seats"] == {"agent": {"mode": "frozen"}}
    assert checkpoint.agent_steps == 128


@pytest.mark.slow
def test_a_mode_lasts_over_a_resumption_unless_the_settings_change(small: Any) -> None:
    config = small(total_steps=640, checkpoint_every_updates=None)
    run = config.runs / "run"
    train(config, reporter=Asking(run, {2: [SetMode("agent", "frozen")]}))
    train(replace(config, total_steps=1_500), resume=run)
    lines = [line["policies"]["agent"] for line in read_metrics(run / "metrics.jsonl")]
    assert [line["is_learning"] for line in lines[:2]] == [1, 1]
    assert {line["is_learning"] for line in lines[2:]} == {0}
    frozen = replace(config.ppo, mode="deterministic")
    train(replace(config, total_steps=3_000, policies={"agent": frozen}), resume=run)
    train(replace(config, total_steps=5_000, policies={"agent": config.ppo}), resume=run)
    lines = [line["policies"]["agent"] for line in read_metrics(run / "metrics.jsonl")]
    assert lines[-1]["is_learning"] == 1


def test_frozen_weights_stay_and_a_schedule_is_followed(small: Any) -> None:
    phases = (Phase(2), Phase(2, {"agent": "deterministic"}))
    config = small(schedule=phases, total_steps=1_300,
                   ppo={"learning_rate_schedule": "constant"}, keep_checkpoints=99,
                   checkpoint_every_updates=1)  # fmt: skip
    result = train(config)
    lines = read_metrics(result.path / "metrics.jsonl")
    learning = [line["policies"]["agent"]["is_learning"] for line in lines]
    assert learning == ([1, 1, 0, 0] * 4)[: len(learning)]
    assert len(learning) > 6
    paths = sorted((result.path / "checkpoints").iterdir())
    weights = [read_checkpoint(path).learners["agent"].tensors["policy.actor.0.weight"]
               for path in paths]  # fmt: skip
    moved = [not torch.equal(one, two) for one, two in itertools.pairwise(weights)]
    assert moved == [bool(mode) for mode in learning]


@pytest.mark.slow
def test_a_folder_is_trained_in_by_one_process_only(small: Any) -> None:
    config = small()
    result = train(config)
    folder = RunFolder(result.path)
    assert not folder.is_running()
    with folder.locked():
        assert folder.is_running()
        with pytest.raises(RunError, match="is being trained by another process") as info:
            train(config, resume=result.path)
    assert "ludus control" in info.value.hint
