"""The scene with known answers; and files that import other libraries, collected where they run."""

from __future__ import annotations

from pathlib import Path

import pytest

from ludus.engine.bundled import bundled_root

_NEED_LIBRARIES = {"test_pettingzoo.py", "test_rllib.py", "test_sb3.py", "test_torchrl.py"}


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave files alone whose tests ``-m`` deselects: without their packages they count as skipped.

    All of their tests have the mark ``libraries``.
    """
    is_deselected = "not libraries" in str(config.getoption("markexpr"))
    return True if is_deselected and collection_path.name in _NEED_LIBRARIES else None


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
