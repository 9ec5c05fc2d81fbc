"""Train policies on a pool of engines with PyTorch.

Names load when they are first used, so that settings can be read without importing PyTorch.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ludus.train.config import LeagueConfig, Phase, PPOConfig, SACConfig, TrainConfig
    from ludus.train.evaluation import Evaluation, evaluate
    from ludus.train.loop import train
    from ludus.train.policy import Player, Policy
    from ludus.train.progress import Progress, Reporter, RunResult
    from ludus.train.saved import load_policies
    from ludus.train.source import open_source

__all__ = [
    "Evaluation",
    "LeagueConfig",
    "PPOConfig",
    "Phase",
    "Player",
    "Policy",
    "Progress",
    "Reporter",
    "RunResult",
    "SACConfig",
    "TrainConfig",
    "evaluate",
    "load_policies",
    "open_source",
    "train",
]

_MODULES = {
    "Evaluation": "evaluation",
    "LeagueConfig": "config",
    "PPOConfig": "config",
    "Phase": "config",
    "Player": "policy",
    "Policy": "policy",
    "Progress": "progress",
    "Reporter": "progress",
    "RunResult": "progress",
    "SACConfig": "config",
    "TrainConfig": "config",
    "evaluate": "evaluation",
    "load_policies": "saved",
    "open_source": "source",
    "train": "loop",
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_MODULES[name]}"), name)
