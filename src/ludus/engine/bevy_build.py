"""The Bevy examples that come with Ludus, built by Cargo."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ludus.engine.bundled import bevy_workspace, package_version
from ludus.engine.cache import require_cache_root
from ludus.errors import SetupError

__all__ = ["PREFIX", "bevy_example_names", "build_bevy_example", "find_bevy_example"]

PREFIX = "bevy:"
_BUILD_TIMEOUT_S = 3600.0


def bevy_example_names() -> list[str]:
    """List the bundled examples, as ``bevy:NAME``."""
    root = bevy_workspace()
    if root is None:
        return []
    found = (root / "examples").glob("*/Cargo.toml")
    return sorted(PREFIX + manifest.parent.name for manifest in found)


def find_bevy_example(text: str) -> str | None:
    """Return the name of the example that ``bevy:NAME`` means, or None."""
    return text.removeprefix(PREFIX) if text in bevy_example_names() else None


def build_bevy_example(name: str) -> Path:
    """Build an example, optimised, and return its executable.

    What is built already is not built again. Cargo tells on stderr how it gets on.

    Raises:
        SetupError: There is no Cargo, or the example cannot be built.
    """
    root = bevy_workspace()
    assert root is not None, "find_bevy_example found the example"
    cargo = shutil.which("cargo")
    if cargo is None:
        raise SetupError(
            f"building {PREFIX}{name} needs Cargo, and there is none on PATH",
            hint="install Rust from https://rustup.rs",
        )
    command = [cargo, "build", "--release", "--locked", "--package", name]
    result = _run([*command, "--message-format", "json-render-diagnostics"], root, name)
    executable = _executable_of(name, result.stdout.splitlines())
    if executable is None:
        raise SetupError(f"Cargo built {PREFIX}{name}, but names no executable")
    return executable


def _run(command: list[str], root: Path, name: str) -> subprocess.CompletedProcess[str]:
    try:
        result = subprocess.run(
            command,
            cwd=root,
            env=_environment(root),
            stdout=subprocess.PIPE,
            text=True,
            timeout=_BUILD_TIMEOUT_S,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise SetupError(f"{PREFIX}{name} cannot be built: {error}") from error
    if result.returncode != 0:
        raise SetupError(
            f"{PREFIX}{name} cannot be built: Cargo ended with {result.returncode}",
            hint=f"read what Cargo says above; {root / 'Cargo.toml'} names the oldest Rust that "
            "serves (rust-version)",
        )
    return result


def _environment(root: Path) -> dict[str, str]:
    """Keep what Cargo builds out of an installed package, which may be read-only."""
    if root.parent.name != "_bundled" or "CARGO_TARGET_DIR" in os.environ:
        return dict(os.environ)
    target = require_cache_root() / "bevy" / package_version()
    return {**os.environ, "CARGO_TARGET_DIR": str(target)}


def _executable_of(name: str, lines: Iterable[str]) -> Path | None:
    """Find the executable in what Cargo tells of its artifacts, one JSON object a line."""
    for line in lines:
        if not line.startswith("{"):
            continue
        message: dict[str, Any] = json.loads(line)
        target: dict[str, Any] = message.get("target") or {}
        if message.get("executable") and target.get("name") == name:
            return Path(message["executable"])
    return None
