"""Games as standard environments: ``gymnasium.Env`` and ``gymnasium.vector.VectorEnv``."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ludus.libraries.making import make, make_registered_vec, make_vec
    from ludus.libraries.single import LudusEnv
    from ludus.libraries.vector import LudusVectorEnv

__all__ = ["LudusEnv", "LudusVectorEnv", "make", "make_registered_vec", "make_vec"]

_HOMES = {
    "LudusEnv": "ludus.libraries.single",
    "LudusVectorEnv": "ludus.libraries.vector",
    "make": "ludus.libraries.making",
    "make_registered_vec": "ludus.libraries.making",
    "make_vec": "ludus.libraries.making",
}


def __getattr__(name: str) -> Any:
    """Import environments when they are first used: ``import ludus`` only registers them."""
    if name not in _HOMES:
        raise AttributeError(f"module 'ludus.libraries' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
