"""Bevy games built by Cargo: the examples that come with Ludus, and packages of users.

``bevy:NAME`` is an example, ``bevy:NAME+FEATURE`` the same built with one of its Cargo features.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tomllib
from pathlib import Path
from typing import Any

from ludus.engine.bundled import bevy_workspace, package_version
from ludus.engine.cache import require_cache_root
from ludus.errors import SetupError, TargetError
from ludus.locks import file_lock

__all__ = [
    "MANIFEST",
    "PREFIX",
    "bevy_example_features",
    "bevy_example_names",
    "build_bevy_example",
    "build_package",
    "find_bevy_example",
    "with_view",
]

PREFIX = "bevy:"
FEATURE_MARK = "+"
MANIFEST = "Cargo.toml"
VIEW = "view"
"""Feature of examples that draw only if asked to."""

_BUILD_TIMEOUT_S = 3600.0


def bevy_example_names() -> list[str]:
    """List the bundled examples, as ``bevy:NAME``."""
    root = bevy_workspace()
    if root is None:
        return []
    found = (root / "examples").glob("*/Cargo.toml")
    return sorted(PREFIX + manifest.parent.name for manifest in found)


def find_bevy_example(text: str) -> str | None:
    """Return the part after ``bevy:``, the name and any features, of an existing example.

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
            hint = f"its features: {', '.join(known) or '(none)'}"
            raise TargetError(f"{example} has no feature {feature!r}", hint)
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

    Cargo builds only what has changed, and reports its progress on stderr. The executable stays
    as it is when the example is built with other features.

    Args:
        name: Of the example; with ``+FEATURE`` after it also features.

    Raises:
        SetupError: There is no Cargo, or the example cannot be built.
    """
    root = bevy_workspace()
    assert root is not None, "find_bevy_example found the example"
    package, *features = name.split(FEATURE_MARK)
    flags = ["--locked", "--package", package, "--example", package]
    flags += ["--features", ",".join(features)] if features else []
    with file_lock(require_cache_root() / "bevy.lock", _BUILD_TIMEOUT_S):
        built = _build(flags, root, f"{PREFIX}{name}")
        if package in built:
            return _keep(built[package], name)
    raise SetupError(f"Cargo built {PREFIX}{name}, but reported no executable")


def build_package(folder: Path) -> Path:
    """Build the game of a Cargo package, optimised, and return its executable.

    Args:
        folder: That of its ``Cargo.toml``.

    Raises:
        SetupError: Cargo is missing, or cannot build the package.
        TargetError: It has no program, or several.
    """
    built = _build(["--bins"], folder, str(folder))
    if len(built) != 1:
        programs = ", ".join(str(path) for path in built.values()) or "none"
        raise TargetError(
            f"{folder} must have one program, and Cargo has built: {programs}",
            "name the executable of the game, or the folder of the package that has it",
        )
    return next(iter(built.values()))


def _build(flags: list[str], folder: Path, name: str) -> dict[str, Path]:
    """Let Cargo build in a folder; return the executables by the names of their targets."""
    cargo = shutil.which("cargo")
    if cargo is None:
        raise SetupError(
            f"building {name} needs Cargo, which is not on PATH",
            hint="install Rust from https://rustup.rs",
        )
    command = [cargo, "build", "--release", *flags]
    lines = _run_cargo([*command, "--message-format", "json-render-diagnostics"], folder, name)
    messages: list[dict[str, Any]] = [json.loads(line) for line in lines if line.startswith("{")]
    return {
        message["target"]["name"]: Path(message["executable"])
        for message in messages
        if message.get("executable")
    }


def _run_cargo(command: list[str], root: Path, name: str) -> list[str]:
    env = dict(os.environ)
    if root.parent.name == "_bundled":  # an installed package, which may be read-only
        target = require_cache_root() / "bevy" / package_version()
        env.setdefault("CARGO_TARGET_DIR", str(target))
    try:
        result = subprocess.run(
            command,
            cwd=root,
            env=env,
            stdout=subprocess.PIPE,
            text=True,
            timeout=_BUILD_TIMEOUT_S,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise SetupError(f"{name} cannot be built: {error}") from error
    if result.returncode != 0:
        raise SetupError(
            f"{name} cannot be built: Cargo ended with {result.returncode}",
            hint=f"read Cargo's messages above; {root / 'Cargo.toml'} names the oldest Rust that "
            "works (rust-version)",
        )
    return result.stdout.splitlines()


def _keep(built: Path, name: str) -> Path:
    """Copy an executable to a file that is named after its features, unless the copy is current.

    Cargo builds an example with other features into the same file, even while it runs.
    """
    kept = built.parent / "kept" / built.with_stem(name).name
    kept.parent.mkdir(exist_ok=True)
    if not kept.exists() or kept.stat().st_mtime_ns != built.stat().st_mtime_ns:
        fresh = kept.with_name(f"{kept.name}.{os.getpid()}")
        shutil.copy2(built, fresh)
        fresh.replace(kept)
    return kept
