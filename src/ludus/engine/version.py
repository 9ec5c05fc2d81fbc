"""Ask a Godot executable for its version."""

from __future__ import annotations

import logging
import re
import subprocess
from functools import lru_cache
from pathlib import Path

from ludus.engine.kinds import Version
from ludus.engine.output import run_captured

__all__ = ["VERSION_TIMEOUT_S", "ask_version", "parse_version", "release_name", "show_version"]

VERSION_TIMEOUT_S = 20.0

_VERSION_LINE = re.compile(r"^\s*(\d+(?:\.\d+)+)\.[a-z]\S*", re.MULTILINE)

_RELEASE = re.compile(r"\d+(?:\.\d+)+\.[a-z]+\d*(?:\.mono)?")

_log = logging.getLogger(__name__)


def parse_version(text: str) -> tuple[Version, str] | None:
    """Find a Godot version such as ``4.6.3.stable.official.abc`` in what ``--version`` printed.

    Returns:
        The numbers and the whole version text, or None if there is no such line.
    """
    match = _VERSION_LINE.search(text)
    if match is None:
        return None
    return tuple(int(part) for part in match[1].split(".")), match[0].strip()


def release_name(version_text: str) -> str:
    """Shorten ``4.6.3.stable.official.abc`` to ``4.6.3.stable``, as export templates are named."""
    match = _RELEASE.match(version_text)
    return version_text if match is None else match[0]


def show_version(version: Version) -> str:
    """Write a version as ``4.6.3``."""
    return ".".join(str(part) for part in version)


def ask_version(path: Path) -> tuple[Version, str] | None:
    """Run ``path --version``; the answer is cached until the file changes.

    Returns:
        The numbers and the version text; None if the file did not answer as Godot does.
    """
    try:
        changed_ns = path.stat().st_mtime_ns
    except OSError:
        return None
    return _ask_version(path, changed_ns)


@lru_cache(maxsize=64)
def _ask_version(path: Path, _changed_ns: int) -> tuple[Version, str] | None:
    try:
        output = run_captured([str(path), "--version"], VERSION_TIMEOUT_S).stdout
    except (OSError, subprocess.TimeoutExpired) as error:
        _log.debug("%s --version failed: %s", path, error)
        return None
    return parse_version(output)
