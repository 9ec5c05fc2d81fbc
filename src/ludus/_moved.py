"""Import paths of earlier versions: each still works, or says what to write instead."""

from __future__ import annotations

import importlib
import importlib.abc
import importlib.machinery
import sys
from collections.abc import Sequence
from types import ModuleType

__all__ = ["install"]

_RENAMED = {
    "ludus.batch": "ludus.spec.batch",
    "ludus.dialects": "ludus.legacy",
    "ludus.envs": "ludus.libraries",
}
"""Packages that have another name; what was below them is below the new name."""

_GONE = {"ludus.train": "from ludus import train, TrainConfig, PPOConfig, SACConfig"}
"""Packages that were removed, with the line to write instead."""


class _MovedFinder(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Answers for the old names only."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if fullname in _GONE:
            raise ImportError(f"{fullname} has moved; write: {_GONE[fullname]}", name=fullname)
        if fullname.startswith("ludus.") and _new_name(fullname) is not None:
            return importlib.machinery.ModuleSpec(fullname, self)
        return None

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> None:
        """Leave the empty module to importlib; it does not stay."""

    def exec_module(self, module: ModuleType) -> None:
        # importlib returns what it finds in sys.modules afterwards, which keeps the new module's
        # own __spec__ and __name__.
        new = _new_name(module.__name__)
        assert new is not None, "find_spec answers for renamed modules only"
        sys.modules[module.__name__] = importlib.import_module(new)


def _new_name(old: str) -> str | None:
    for package, new in _RENAMED.items():
        if old == package or old.startswith(f"{package}."):
            return new + old.removeprefix(package)
    return None


def install() -> None:
    """Let old import paths be found; a second call changes nothing."""
    if not any(isinstance(finder, _MovedFinder) for finder in sys.meta_path):
        # First: a __pycache__ that an update leaves behind is a package of the old name.
        sys.meta_path.insert(0, _MovedFinder())
