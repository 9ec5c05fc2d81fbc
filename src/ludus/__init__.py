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

from ludus.registration import register_examples
from ludus.version import __version__

if TYPE_CHECKING:
    from ludus.envs import LudusEnv, LudusVectorEnv, make, make_vec
    from ludus.errors import LudusError
    from ludus.pool import PoolConfig, open_pool

__all__ = [
    "LudusEnv",
    "LudusError",
    "LudusVectorEnv",
    "PoolConfig",
    "__version__",
    "make",
    "make_vec",
    "open_pool",
]

_HOMES = {
    "LudusEnv": "ludus.envs",
    "LudusError": "ludus.errors",
    "LudusVectorEnv": "ludus.envs",
    "PoolConfig": "ludus.pool",
    "make": "ludus.envs",
    "make_vec": "ludus.envs",
    "open_pool": "ludus.pool",
}

register_examples()


def __getattr__(name: str) -> Any:
    """Import public names when they are first used, so that ``import ludus`` stays quick."""
    if name not in _HOMES:
        raise AttributeError(f"module 'ludus' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
