"""Run the programs of an unpacked prefix with the prefix's own libraries.

A prefix holds packages that were unpacked without being installed. Its libraries may be newer
than those of the system, so its programs start through its own loader.
"""

from __future__ import annotations

import shlex
import subprocess
from pathlib import Path

from ludus.engine.output import run_captured
from ludus.errors import SetupError

__all__ = [
    "bind_to_prefix",
    "find_program",
    "library_folders",
    "remove_library_paths",
    "replace_path",
    "write_launcher",
]

PATCH_TIMEOUT_S = 60.0

_LOADERS = ("usr/lib64/ld-linux-*.so.*", "usr/lib/ld-linux-*.so.*", "usr/lib/*/ld-linux-*.so.*")

# `exec` keeps the process id: the one that Python supervises is the engine itself.
_SCRIPT = """\
#!/bin/sh
# Written by Ludus. Starts a program with the libraries beside this script; both can be moved
# together.
prefix=$(dirname -- "$(readlink -f -- "$0")")/{prefix}
{environment}{setup}exec "$prefix/{loader}" --library-path "{library_path}" \\
  --argv0 {name} "$prefix/{program}" "$@"
"""


def find_program(prefix: Path, name: str) -> Path:
    """Return a program of the prefix.

    Raises:
        SetupError: The prefix does not contain it.
    """
    for folder in ("bin", "games"):
        program = prefix / "usr" / folder / name
        if program.is_file():
            return program
    raise SetupError(f"the unpacked packages do not contain the program {name}")


def library_folders(prefix: Path) -> tuple[str, ...]:
    """Return the folders of the prefix's libraries, relative to the prefix."""
    libraries = _first(prefix, ("usr/lib/*-linux-gnu*",)) or "usr/lib"
    return libraries, f"{libraries}/pulseaudio"


def write_launcher(launcher: Path, prefix: Path, program: Path, setup: str = "") -> None:
    """Write an executable script that starts ``program``; the three can only be moved together.

    Args:
        launcher: The script.
        prefix: Folder of the unpacked packages, beside or below the script.
        program: A program of the prefix.
        setup: Lines of shell that run before the program; ``$prefix`` is the prefix.

    Raises:
        SetupError: The prefix has no loader.
    """
    folders = library_folders(prefix)
    script = _SCRIPT.format(
        prefix=shlex.quote(prefix.relative_to(launcher.parent).as_posix()),
        environment=_environment(prefix, folders[0]),
        setup=setup,
        loader=_find_loader(prefix),
        library_path=":".join(f"$prefix/{folder}" for folder in folders),
        name=shlex.quote(program.name),
        program=program.relative_to(prefix).as_posix(),
    )
    launcher.write_text(script, encoding="utf-8")
    launcher.chmod(0o755)


def bind_to_prefix(program: Path, prefix: Path) -> None:
    """Change a program so that it starts with the loader and the libraries of ``prefix``.

    It then runs on this machine only, and as long as the prefix stays where it is. An exported
    game needs this: it looks for its data beside the running executable, which would be the
    loader if a launcher started it.

    Raises:
        SetupError: The prefix lacks a loader or ``patchelf``, or the program is damaged.
    """
    loader = prefix / _find_loader(prefix)
    # Not RUNPATH: that would not apply to libraries loaded by other libraries.
    options = ["--force-rpath", "--set-rpath", _library_path(prefix)]
    _patch(prefix, program, ["--set-interpreter", str(loader), *options])


def remove_library_paths(prefix: Path, pattern: str) -> None:
    """Remove from libraries the fixed paths in which they look for other libraries.

    Raises:
        SetupError: The prefix lacks a loader or ``patchelf``, or a library is damaged.
    """
    for folder in library_folders(prefix):
        for library in (prefix / folder).glob(pattern):
            if not library.is_symlink():
                _patch(prefix, library, ["--remove-rpath"])


def replace_path(program: Path, old: str, new: str) -> None:
    """Replace a path in an executable's string constants by one that is not longer.

    Raises:
        SetupError: The path does not occur exactly once.
    """
    data = program.read_bytes()
    before = b"\0" + old.encode() + b"\0"
    if (count := data.count(before)) != 1:
        raise SetupError(f"{program.name} contains the path {old} {count} times, expected once")
    after = b"\0" + new.encode().ljust(len(old) + 1, b"\0")
    program.write_bytes(data.replace(before, after))


def _find_loader(prefix: Path) -> str:
    loader = _first(prefix, _LOADERS)
    if loader is None:
        raise SetupError("the unpacked packages have no program loader (package libc6)")
    return loader


def _first(prefix: Path, patterns: tuple[str, ...]) -> str | None:
    found = (path for pattern in patterns for path in sorted(prefix.glob(pattern)))
    return next((path.relative_to(prefix).as_posix() for path in found), None)


def _library_path(prefix: Path) -> str:
    return ":".join(str(prefix / folder) for folder in library_folders(prefix))


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


def _patch(prefix: Path, file: Path, options: list[str]) -> None:
    tool = find_program(prefix, "patchelf")
    loader = [str(prefix / _find_loader(prefix)), "--library-path", _library_path(prefix)]
    try:
        done = run_captured([*loader, str(tool), *options, str(file)], PATCH_TIMEOUT_S)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise SetupError(f"{tool} failed on {file}: {error}") from error
    if done.returncode != 0:
        raise SetupError(f"{tool} failed on {file}: {done.stdout.strip()}")
