"""Workers without processes, and how to compare what runs leave."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import pytest
import torch

from ludus.runs.checkpoint import Checkpoint, read_checkpoint
from ludus.runs.run_folder import RunFolder
from ludus.settings.train_config import TrainConfig
from ludus.workers import opening
from ludus.workers.worker import Worker


class InProcess:
    """A :class:`~ludus.workers.interface.Machine` in this process; all it says is pickled."""

    def __init__(self, config: TrainConfig, index: int, log_dir: Path | None) -> None:
        self.name = f"machine {index}"
        self._worker = Worker(config, index, log_dir)
        self._answer: Any = self._worker.spec

    def send(self, method: str, *arguments: Any) -> None:
        self._answer = getattr(self._worker, method)(*pickle.loads(pickle.dumps(arguments)))

    def receive(self) -> Any:
        return pickle.loads(pickle.dumps(self._answer))

    def close(self) -> None:
        self._worker.close()


def use_in_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let ``local:N`` be workers in this process, which start at once."""
    monkeypatch.setattr(opening, "ProcessMachine", InProcess)


def newest(run: Path) -> Checkpoint:
    return read_checkpoint(RunFolder(run).checkpoints().paths()[-1], has_replay=True)


def assert_equal(first: Checkpoint, second: Checkpoint) -> None:
    """Compare everything that a later run depends on."""
    assert first.agent_steps == second.agent_steps
    for name in ("updates", "episodes", "seats", "league"):
        assert first.run.get(name) == second.run.get(name), name
    assert first.learners.keys() == second.learners.keys()
    pairs = [(first.league, second.league)]
    for name, learner in first.learners.items():
        pairs.append((learner.tensors, second.learners[name].tensors))
        pairs.append((learner.replay, second.learners[name].replay))
        assert learner.values == second.learners[name].values
    for one, two in pairs:
        assert one.keys() == two.keys()
        assert [name for name in one if not torch.equal(one[name], two[name])] == []
