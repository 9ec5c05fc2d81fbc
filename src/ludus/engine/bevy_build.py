"""The Bevy examples that come with Ludus, built by Cargo.

``bevy:NAME`` is an example, ``bevy:NAME+FEATURE`` the same built with one of its Cargo features.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ludus.engine.bundled import bevy_workspace, package_version
from ludus.engine.cache import require_cache_root
from ludus.errors import SetupError, TargetError
from ludus.locks import file_lock

__all__ = [
    "PREFIX",
    "bevy_example_features",
    "bevy_example_names",
    "build_bevy_example",
    "find_bevy_example",
    "with_view",
]

PREFIX = "bevy:"
FEATURE_MARK = "+"
VIEW = "view"
"""Feature of examples that draw only where somebody wants to see them."""

_BUILD_TIMEOUT_S = 3600.0
_KEPT = "kept"
"""Folder beside the executables that Cargo builds, where each example with its features has a name
of its own. To Cargo they are one file, which the next build replaces, whoever plays it."""


def bevy_example_names() -> list[str]:
    """List the bundled examples, as ``bevy:NAME``."""
    root = bevy_workspace()
    if root is None:
        return []
    found = (root / "examples").glob("*/Cargo.toml")
    return sorted(PREFIX + manifest.parent.name for manifest in found)


def find_bevy_example(text: str) -> str | None:
    """Return what follows ``bevy:``, the name and perhaps features, if it means an example.

    Raises:
        TargetError: The example has no such feature.
    """
    example, *features = text.split(FEATURE_MARK)
    if example not in bevy_example_names():
        return None
    name = example.removeprefix(PREFIX)
    known = bevy_example_features(name)
    for feature in features:
        if feature not in known:
            raise TargetError(
                f"{example} has no feature {feature!r}",
                hint=f"it has {', '.join(known) or 'none'}",
            )
    return text.removeprefix(PREFIX)


def bevy_example_features(name: str) -> list[str]:
    """List the Cargo features of an example."""
    root = bevy_workspace()
    assert root is not None, "the example was found"
    manifest = tomllib.loads((root / "examples" / name / "Cargo.toml").read_text("utf-8"))
    return sorted(manifest.get("features", {}))


def with_view(target: str) -> str:
    """Add the feature ``view`` to an example that has it; return other targets as they are."""
    if FEATURE_MARK in target or find_bevy_example(target) is None:
        return target
    has_view = VIEW in bevy_example_features(target.removeprefix(PREFIX))
    return f"{target}{FEATURE_MARK}{VIEW}" if has_view else target


def build_bevy_example(name: str) -> Path:
    """Build an example, optimised, and return its executable.

    What is built already is not built again. Cargo tells on stderr how it gets on. The executable
    stays as it is when the example is built with other features.

    Args:
        name: Of the example; with ``+FEATURE`` after it also features.

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
    package, *features = name.split(FEATURE_MARK)
    command = [cargo, "build", "--release", "--locked", "--package", package]
    command += ["--features", ",".join(features)] if features else []
    with file_lock(require_cache_root() / "bevy.lock", _BUILD_TIMEOUT_S):
        result = _run([*command, "--message-format", "json-render-diagnostics"], root, name)
        executable = _executable_of(package, result.stdout.splitlines())
        if executable is None:
            raise SetupError(f"Cargo built {PREFIX}{name}, but names no executable")
        return _kept(executable, name)


def _kept(built: Path, name: str) -> Path:
    """Copy an executable to where it stays, if the copy is not there yet."""
    kept = built.parent / _KEPT / built.with_stem(name).name
    kept.parent.mkdir(exist_ok=True)
    if not kept.exists() or kept.stat().st_mtime_ns != built.stat().st_mtime_ns:
        fresh = kept.with_name(f"{kept.name}.{os.getpid()}")
        shutil.copy2(built, fresh)
        fresh.replace(kept)
    return kept


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
