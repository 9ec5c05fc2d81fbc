"""Pretended engines for tests that need none."""

from __future__ import annotations

from pathlib import Path


def fake_godot(path: Path, version: str) -> Path:
    """Write a script that answers ``--version``."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\necho '{version}'\n")
    path.chmod(0o755)
    return path
