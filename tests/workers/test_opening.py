"""Machines that cannot be started or ended leave none of the others."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import pytest

from ludus.settings.train_config import TrainConfig
from ludus.workers import opening
from ludus.workers.opening import open_machines
from tests.workers.machines import InProcess

CONFIG = TrainConfig(target="gym:CartPole-v1", num_worlds=1, num_engines=1, cluster="local:3")


class Frail(InProcess):
    """Machine ``broken`` cannot be started, ``stubborn`` cannot be ended."""

    broken = stubborn = -1
    closed: ClassVar[set[int]] = set()

    def __init__(self, config: TrainConfig, index: int, log_dir: Path | None) -> None:
        if index == self.broken:
            raise OSError("it cannot be started")
        super().__init__(config, index, log_dir)
        self._index = index

    def close(self) -> None:
        super().close()
        if self._index == self.stubborn:
            raise OSError("it cannot be ended")
        self.closed.add(self._index)


@pytest.fixture(autouse=True)
def frail(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(opening, "ProcessMachine", Frail)
    Frail.closed.clear()


@pytest.mark.parametrize("index", [1, 2])
def test_a_machine_that_cannot_be_started(index: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Frail, "broken", index)
    with pytest.raises(OSError, match="it cannot be started"):
        open_machines(CONFIG)
    assert Frail.closed == set(range(index))


@pytest.mark.parametrize("index", range(3))
def test_a_machine_that_cannot_be_ended(index: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Frail, "stubborn", index)
    pool = open_machines(CONFIG)
    assert Frail.closed == set()
    with pytest.raises(OSError, match="it cannot be ended"):
        pool.close()
    assert Frail.closed == {0, 1, 2} - {index}
