"""The virtual environment of a project, made with the Ludus that installed the add-on.

Which Ludus that was stands in the user's configuration, never in the project, which others get.
"""

from __future__ import annotations

import contextlib
import importlib.metadata
import json
import os
import re
import shutil
import subprocess
import sys
import venv
from pathlib import Path
from typing import Any, cast

import platformdirs

from ludus.disk import write_atomically
from ludus.engine.project import find_project
from ludus.errors import ConfigError, SetupError

__all__ = [
    "ENVIRONMENT", "installer_file", "make_environment", "measure_environment",
    "remember_installer",
]  # fmt: skip

ENVIRONMENT = ".venv"
DISTRIBUTION = "ludus-rl"
EXTRAS = ("train", "record")
"""What the panel in the editor needs: training, and films."""
UNFINISHED = "ludus-unfinished"
"""A file in an environment that is being made; without it, the environment is whole."""


def installer_file() -> Path:
    """Return the file of the user's configuration that names the Python with this Ludus."""
    return platformdirs.user_config_path("ludus", appauthor=False, roaming=True) / "python"


def remember_installer() -> None:
    """Note that this Python has the Ludus that installs add-ons; the editor's panel looks there.

    A configuration that cannot be written is left as it is: the panel then asks for a Python.
    """
    file = installer_file()
    with contextlib.suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(file, (sys.executable + "\n").encode())


def measure_environment() -> int:
    """Return about how many bytes the packages of an environment take, those of this one."""
    found: dict[str, int] = {}
    _measure(DISTRIBUTION, set(EXTRAS), found)
    return sum(found.values())


def make_environment(project: Path) -> Path:
    """Make ``.venv`` in a project, with the Ludus that this Python has; return its Python.

    If it fails or is interrupted, nothing is left of it.

    Raises:
        TargetError: There is no Godot project.
        ConfigError: The project has an environment already.
        SetupError: It could not be made, or a package could not be installed.
    """
    folder = find_project(project).root / ENVIRONMENT
    if (folder / UNFINISHED).exists():  # its maker was killed
        shutil.rmtree(folder)
    if folder.exists() or folder.is_symlink():
        raise ConfigError(f"{folder} exists already", "use it, or remove it first")
    try:
        folder.mkdir()
        (folder / UNFINISHED).touch()
        venv.EnvBuilder(with_pip=True).create(folder)
        python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
        _install(python, requirement())
        (folder / ".gdignore").touch()
        (folder / ".gitignore").write_text("*\n")
        (folder / UNFINISHED).unlink()
    except BaseException as error:
        shutil.rmtree(folder, ignore_errors=True)
        if isinstance(error, OSError | subprocess.CalledProcessError):
            raise SetupError(
                f"{folder} could not be made: {error}",
                "on Debian the module venv is in the package python3-venv",
            ) from error
        raise
    return python


def requirement() -> str:
    """Return what pip installs for this very Ludus: its checkout, or its version."""
    extras = ",".join(EXTRAS)
    distribution = importlib.metadata.distribution(DISTRIBUTION)
    text = distribution.read_text("direct_url.json")
    origin = cast(dict[str, Any], json.loads(text)) if text else {}
    url = str(origin.get("url", ""))
    if url:
        return f"{DISTRIBUTION}[{extras}] @ {url}"
    return f"{DISTRIBUTION}[{extras}]=={distribution.version}"


def _install(python: Path, what: str) -> None:
    """Install with pip, which is ended with us."""
    command = [str(python), "-m", "pip", "install", "--disable-pip-version-check",
               "--progress-bar", "off", what]  # fmt: skip
    with subprocess.Popen(command, stdin=subprocess.DEVNULL) as pip:
        try:
            exit_code = pip.wait()
        except BaseException:
            pip.kill()
            raise
    if exit_code != 0:
        raise SetupError(f"pip could not install {what}, exit code {exit_code}")


def _measure(name: str, extras: set[str], found: dict[str, int]) -> None:
    """Add the sizes of a package and of what it requires, by name."""
    try:
        distribution = importlib.metadata.distribution(name)
    except importlib.metadata.PackageNotFoundError:
        return
    key = name.lower().replace("_", "-")
    is_new = key not in found
    if is_new:
        files = distribution.files or []
        found[key] = sum(file.size or 0 for file in files)
    for text in distribution.requires or []:
        needed = re.match(r"([\w.-]+)(?:\[([\w,.\s-]*)\])?", text)
        extra = re.search(r"extra\s*==\s*['\"]([\w.-]+)['\"]", text)
        if needed is None or (extra is not None and extra[1] not in extras):
            continue
        wanted = set((needed[2] or "").replace(" ", "").split(",")) - {""}
        if is_new or wanted:
            _measure(needed[1], wanted, found)
