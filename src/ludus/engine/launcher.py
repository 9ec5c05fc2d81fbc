"""The script that starts a program of an unpacked prefix with the prefix's own libraries."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

from ludus.errors import SetupError

__all__ = ["find_loader", "find_program", "library_folders", "write_launcher"]

_LOADERS = ("usr/lib64/ld-linux-*.so.*", "usr/lib/ld-linux-*.so.*", "usr/lib/*/ld-linux-*.so.*")

# `exec` keeps the process id: the one that Python supervises is the engine itself.
_SCRIPT = """\
#!/bin/sh
# Written by Ludus. Starts an engine with the libraries that lie beside it; can be moved
# together with them.
prefix=$(dirname -- "$(readlink -f -- "$0")")/{prefix}
{environment}{setup}exec "$prefix/{loader}" --library-path "{library_path}" \\
  --argv0 {name} "$prefix/{program}" "$@"
"""


def find_program(prefix: Path, names: Sequence[str]) -> Path:
    """Return the first of several programs that the prefix has.

    Raises:
        SetupError: It has none of them.
    """
    for folder in ("bin", "games"):
        for name in names:
            program = prefix / "usr" / folder / name
            if program.is_file():
                return program
    raise SetupError(f"the unpacked packages have no {' or '.join(names)}")


def find_loader(prefix: Path) -> str:
    """Return the path inside the prefix of what starts its programs.

    Raises:
        SetupError: The prefix has none.
    """
    loader = _first(prefix, _LOADERS)
    if loader is None:
        raise SetupError("the unpacked packages have no program loader (package libc6)")
    return loader


def library_folders(prefix: Path) -> tuple[str, ...]:
    """Return the paths inside the prefix of the folders that hold its libraries."""
    libraries = _first(prefix, ("usr/lib/*-linux-gnu*",)) or "usr/lib"
    return libraries, f"{libraries}/pulseaudio"


def write_launcher(launcher: Path, prefix: Path, program: Path, setup: str = "") -> None:
    """Write an executable script that starts ``program``; all three keep their places.

    Args:
        launcher: The script.
        prefix: Folder of the unpacked packages, beside or below the script.
        program: One of the prefix.
        setup: Lines of shell that run before the program; ``$prefix`` is the prefix.

    Raises:
        SetupError: The prefix has no loader.
    """
    folders = library_folders(prefix)
    script = _SCRIPT.format(
        prefix=shlex.quote(prefix.relative_to(launcher.parent).as_posix()),
        environment=_environment(prefix, folders[0]),
        setup=setup,
        loader=find_loader(prefix),
        library_path=":".join(f"$prefix/{folder}" for folder in folders),
        name=shlex.quote(program.name),
        program=program.relative_to(prefix).as_posix(),
    )
    launcher.write_text(script, encoding="utf-8")
    launcher.chmod(0o755)


def _first(prefix: Path, patterns: Sequence[str]) -> str | None:
    for pattern in patterns:
        for path in sorted(prefix.glob(pattern)):
            return path.relative_to(prefix).as_posix()
    return None


def _environment(prefix: Path, libraries: str) -> str:
    """Point programs at the drivers and locales of the prefix, where it has any."""
    values: list[str] = []
    if (prefix / "usr/share/glvnd/egl_vendor.d/50_mesa.json").is_file():
        values += [
            '__EGL_VENDOR_LIBRARY_FILENAMES="$prefix/usr/share/glvnd/egl_vendor.d/50_mesa.json"',
            f'LIBGL_DRIVERS_PATH="$prefix/{libraries}/dri"',
            f'GBM_BACKENDS_PATH="$prefix/{libraries}/gbm"',
            'LIBGL_ALWAYS_SOFTWARE="${LIBGL_ALWAYS_SOFTWARE:-1}"',
        ]
    if (prefix / "usr/share/X11/locale").is_dir():
        values.append('XLOCALEDIR="$prefix/usr/share/X11/locale"')
    return "".join(f"export {value}\n" for value in values)
