"""Fast reinforcement-learning environments from games, trained with PyTorch.

>>> import ludus
>>> env = ludus.make("cartpole")                                       # doctest: +SKIP
>>> envs = ludus.make_vec("cartpole", num_worlds=64, num_engines=2)    # doctest: +SKIP
"""

from __future__ import annotations

from ludus.folder_imports import drop_current_folder

drop_current_folder()  # before anything else is imported

# ruff: noqa: E402
from importlib import import_module
from typing import TYPE_CHECKING, Any

from ludus import _moved
from ludus.libraries.registration import register_examples
from ludus.version import __version__

if TYPE_CHECKING:
    from ludus.api.acting import LoadedPolicy, load_policy
    from ludus.api.evaluating import evaluate
    from ludus.api.running import Run, train
    from ludus.api.sweeping import sweep
    from ludus.errors import LudusError
    from ludus.libraries import LudusEnv, LudusVectorEnv, make, make_vec
    from ludus.play.evaluation import Evaluation
    from ludus.pool import PoolConfig, open_pool
    from ludus.settings.train_config import (
        ImitationConfig,
        LeagueConfig,
        Phase,
        PPOConfig,
        SACConfig,
        TrainConfig,
    )
    from ludus.training.hooks import Episode, Training
    from ludus.training.progress import Progress

__all__ = [
    "Episode",
    "Evaluation",
    "ImitationConfig",
    "LeagueConfig",
    "LoadedPolicy",
    "LudusEnv",
    "LudusError",
    "LudusVectorEnv",
    "PPOConfig",
    "Phase",
    "PoolConfig",
    "Progress",
    "Run",
    "SACConfig",
    "TrainConfig",
    "Training",
    "__version__",
    "evaluate",
    "load_policy",
    "make",
    "make_vec",
    "open_pool",
    "sweep",
    "train",
]

_HOMES = {
    "Episode": "ludus.training.hooks",
    "Evaluation": "ludus.play.evaluation",
    "ImitationConfig": "ludus.settings.train_config",
    "LeagueConfig": "ludus.settings.train_config",
    "LoadedPolicy": "ludus.api.acting",
    "LudusEnv": "ludus.libraries",
    "LudusError": "ludus.errors",
    "LudusVectorEnv": "ludus.libraries",
    "PPOConfig": "ludus.settings.train_config",
    "Phase": "ludus.settings.train_config",
    "PoolConfig": "ludus.pool",
    "Progress": "ludus.training.progress",
    "Run": "ludus.api.running",
    "SACConfig": "ludus.settings.train_config",
    "TrainConfig": "ludus.settings.train_config",
    "Training": "ludus.training.hooks",
    "evaluate": "ludus.api.evaluating",
    "load_policy": "ludus.api.acting",
    "make": "ludus.libraries",
    "make_vec": "ludus.libraries",
    "open_pool": "ludus.pool",
    "sweep": "ludus.api.sweeping",
    "train": "ludus.api.running",
}

_LIBRARIES = {"pettingzoo", "rllib", "sb3", "wrappers"}
"""Modules for other libraries, which need not be imported by themselves."""

_moved.install()
register_examples()


def __getattr__(name: str) -> Any:
    """Import public names when they are first used, so that ``import ludus`` stays quick."""
    if name in _LIBRARIES:
        return import_module(f"ludus.{name}")
    if name not in _HOMES:
        raise AttributeError(f"module 'ludus' has no attribute {name!r}")
    try:
        return getattr(import_module(_HOMES[name]), name)
    except ModuleNotFoundError as error:
        from ludus.extras import EXTRAS, missing_extra

        if error.name not in EXTRAS:
            raise
        raise missing_extra(error.name) from error


def __dir__() -> list[str]:
    return sorted(__all__)
