"""What may be imported from the current folder: the MODULE of ``gym:MODULE:ID``, nothing else.

Many libraries try optional imports (``dill``, ``_winapi``, ``nt``). With the current folder on
``sys.path``, a command run in a downloaded repository would run whatever files there have these
names. Instead, a finder at the end of ``sys.meta_path`` serves MODULE, and what MODULE imports.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import find_spec
from types import FrameType, ModuleType
from typing import Any

__all__ = ["FolderFinder", "drop_current_folder", "look_in_current_folder"]

_IMPORTERS = ("importlib", "_frozen_importlib", "_frozen_importlib_external")
_REGISTRY = "gymnasium.envs.registration"


class FolderFinder:
    """Serves chosen modules of one folder, and the modules there that those import.

    Who imports is told by the importing module's name, not by its file: a virtual environment
    often lies in the same folder, and its libraries may not import from there.

    Args:
        folder: Absolute path.
        names: Top-level modules to serve to every importer.
    """

    def __init__(self, folder: str, names: Sequence[str]) -> None:
        self.folder = folder
        self.names = set(names)

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return where a module is, or None if it is not there or may not come from there."""
        if path is not None:  # in a package, which knows its own folder
            return None
        if fullname not in self.names and not self._may_import(_importing_module()):
            return None
        spec = PathFinder.find_spec(fullname, [self.folder])
        if spec is not None:
            self.names.add(fullname)
        return spec

    def _may_import(self, module: str) -> bool:
        # Gymnasium imports entry points for the module that has registered them.
        return module == _REGISTRY or module.partition(".")[0] in self.names

    def __reduce__(self) -> tuple[Any, ...]:
        return _install, (self.folder, sorted(self.names))


def look_in_current_folder(module: str) -> None:
    """Make ``module`` importable from the current folder, unless it is installed.

    It keeps working after a change of folder, and in processes started by ``multiprocessing``.
    """
    name = module.partition(".")[0]
    if not name or name in sys.modules or find_spec(name) is not None:
        return
    folder = os.getcwd()  # noqa: PTH109 - pathlib is not imported yet
    if PathFinder.find_spec(name, [folder]) is not None:
        _install(folder, [name])


def drop_current_folder() -> None:
    """Remove the current folder from ``sys.path`` if ``python -m ludus`` has put it there.

    To be called while the package is imported: ``sys.argv[0]`` is ``-m`` only that long.
    """
    if sys.flags.safe_path or sys.argv[:1] != ["-m"]:
        return
    module = sys.orig_argv[-len(sys.argv)].removeprefix("-m")
    if module.partition(".")[0] == "ludus" and sys.path[:1] in ([""], [os.getcwd()]):  # noqa: PTH109
        del sys.path[0]


def _importing_module() -> str:
    """Return the name of the module whose code runs the import, "" if it has none."""
    frame: FrameType | None = sys._getframe(2)  # pyright: ignore[reportPrivateUsage]
    while frame is not None:
        name = str(frame.f_globals.get("__name__", ""))
        if name.partition(".")[0] not in _IMPORTERS:
            return name
        frame = frame.f_back
    return ""


def _install(folder: str, names: Sequence[str]) -> FolderFinder:
    for finder in sys.meta_path:
        if isinstance(finder, FolderFinder) and finder.folder == folder:
            finder.names.update(names)
            return finder
    finder = FolderFinder(folder, names)
    sys.meta_path.append(finder)
    _pass_on_to_workers()
    return finder


def _pass_on_to_workers() -> None:
    """Let processes that ``multiprocessing`` starts (not forks) have the finders, too.

    There is no public hook. The data that prepares a worker is the first thing that it unpickles,
    before classes and functions of MODULE; unpickling a finder installs it.
    """
    from multiprocessing import spawn, util

    internals: Any = util
    prepare, flags = spawn.get_preparation_data, internals._args_from_interpreter_flags
    if hasattr(prepare, "passes_on_finders"):
        return

    def get_preparation_data(name: str) -> dict[str, Any]:
        finders = [finder for finder in sys.meta_path if isinstance(finder, FolderFinder)]
        return {**prepare(name), "ludus_finders": finders}

    def args_from_interpreter_flags() -> list[str]:
        # Workers begin as `python -c`, which looks in the current folder first, until the data
        # has given them the sys.path of this process.
        return [*(flag for flag in flags() if flag != "-P"), "-P"]

    patched: Any = get_preparation_data
    patched.passes_on_finders = True
    spawn.get_preparation_data = patched
    internals._args_from_interpreter_flags = args_from_interpreter_flags
