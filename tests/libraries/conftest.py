"""The scene with known answers."""

from __future__ import annotations

from pathlib import Path

import pytest

from ludus.engine.bundled import bundled_root


@pytest.fixture(scope="session")
def tasks() -> Path:
    """The folder of the small tasks among the examples."""
    return bundled_root() / "examples/identity"


@pytest.fixture(scope="session")
def oracle(tasks: Path) -> Path:
    """One agent that observes episode, step, last action, first random number and ticks.

    Two ticks a step; the reward is 0.1 times the step; it terminates after 5 steps, or after
    ``length``, and is truncated after ``truncate_after``.
    """
    return tasks / "oracle.tscn"
