"""Pretended engines, and installers of them, for tests that need none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from ludus.engine.installing import InstallerUnavailable, Progress, Unpacked


def fake_godot(path: Path, version: str) -> Path:
    """Write a script that answers ``--version``."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\necho '{version}'\n")
    path.chmod(0o755)
    return path


@dataclass
class FakeInstaller:
    """An installer that writes a script instead of an engine or a template."""

    act: Callable[[Path], None] | None = None
    version: str = "4.6.3.stable"
    name: str = "fake"
    has_rendering: bool = False
    needs_prefix: bool = False
    calls: list[Path] = field(default_factory=list[Path])

    def unpack(self, folder: Path, progress: Progress) -> Unpacked:
        self.calls.append(folder)
        progress("unpack", None)
        program = fake_godot(folder / "godot", self.version)
        if self.act is not None:
            self.act(folder)
        prefix = folder if self.needs_prefix else None
        return Unpacked(program, program, program, self.has_rendering, prefix)


FakeTemplateInstaller = partial(FakeInstaller, version="4.6.3.stable.official.abc", name="official")


def refuse(_folder: Path) -> None:
    """Be an installer that cannot be used."""
    raise InstallerUnavailable("no network")


def visible(folder: Path) -> list[str]:
    """Return the installations in a folder of the cache, and what should not be there."""
    return sorted(entry.name for entry in folder.iterdir() if entry.name != ".install.lock")
