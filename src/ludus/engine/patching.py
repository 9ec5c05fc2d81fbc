"""Make a program of an unpacked prefix start from anywhere, with the libraries of that prefix.

A launcher script will not do for an exported game: it looks for its data beside the executable
that runs, and started through a loader that would be the loader.
"""

from __future__ import annotations

import subprocess
from pathlib import Path

from ludus.engine.launcher import find_loader, find_program, library_folders
from ludus.errors import SetupError

__all__ = ["bind_to_prefix", "forget_library_paths"]

PATCH_TIMEOUT_S = 60.0


def bind_to_prefix(program: Path, prefix: Path) -> None:
    """Change a program so that it starts with the loader and the libraries of ``prefix``.

    It then runs on this machine only, and as long as the prefix stays where it is.

    Raises:
        SetupError: The prefix lacks a loader or ``patchelf``, or the program is damaged.
    """
    loader = prefix / find_loader(prefix)
    path = ":".join(str(prefix / folder) for folder in library_folders(prefix))
    # Not RUNPATH: it would not hold for the libraries of the libraries.
    options = ["--force-rpath", "--set-rpath", path]
    _patch(prefix, program, ["--set-interpreter", str(loader), *options])


def forget_library_paths(prefix: Path, pattern: str) -> None:
    """Remove from libraries the fixed places in which they look for other libraries.

    Raises:
        SetupError: The prefix lacks a loader or ``patchelf``, or a library is damaged.
    """
    for folder in library_folders(prefix):
        for library in (prefix / folder).glob(pattern):
            if not library.is_symlink():
                _patch(prefix, library, ["--remove-rpath"])


def _patch(prefix: Path, file: Path, options: list[str]) -> None:
    libraries = ":".join(str(prefix / folder) for folder in library_folders(prefix))
    tool = find_program(prefix, ["patchelf"])
    loader = [str(prefix / find_loader(prefix)), "--library-path", libraries]
    try:
        done = subprocess.run(
            [*loader, str(tool), *options, str(file)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            timeout=PATCH_TIMEOUT_S,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise SetupError(f"{tool} failed on {file}: {error}") from error
    if done.returncode != 0:
        raise SetupError(f"{tool} failed on {file}: {done.stdout.strip()}")
