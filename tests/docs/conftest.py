"""Training as the pages show it, in shorter runs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import ludus


@pytest.fixture
def shorten_training(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Return what limits the steps of `ludus.train`, for 16 worlds in one engine; runs lie here."""
    monkeypatch.chdir(tmp_path)

    def shorten(total_steps: int) -> None:
        train: Any = ludus.train
        short = {"total_steps": total_steps, "num_worlds": 16, "num_engines": 1}

        def train_shortly(*given: Any, **named: Any) -> Any:
            return train(*given, **{**named, **short, "evaluation_episodes": 2})

        monkeypatch.setattr(ludus, "train", train_shortly, raising=False)

    return shorten
