"""Look at the machine, and say what is there and what is missing."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
import platform
import shutil
import socket
import sys
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from ludus.engine.affinity import allowed_cores
from ludus.engine.cache import cache_root, cached_engines
from ludus.engine.find import search_engines
from ludus.engine.kinds import EngineKind
from ludus.engine.screen import find_xvfb
from ludus.engine.template import cached_templates, matching_template
from ludus.engine.version import release_name, show_version

__all__ = ["Finding", "FindingStatus", "doctor"]


class FindingStatus(StrEnum):
    """How good a finding is."""

    OK = "ok"
    WARN = "warn"
    FAIL = "fail"


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at.

    Attributes:
        name: What was looked at.
        status: ``warn`` limits what can be done; ``fail`` prevents running anything.
        detail: What was found.
        hint: What to do about it, if anything.
    """

    name: str
    status: FindingStatus
    detail: str
    hint: str = ""


def doctor() -> list[Finding]:
    """Examine this machine; nothing is changed, started (but ``--version``) or downloaded."""
    return [
        _python(),
        _engine(EngineKind.GODOT4, FindingStatus.FAIL),
        _engine(EngineKind.GODOT3, FindingStatus.WARN),
        _template(),
        _cache(),
        _cores(),
        _local_sockets(),
        _screen(),
        _torch(),
        _cuda(),
    ]


def _python() -> Finding:
    detail = f"{platform.python_version()} on {platform.platform()}"
    return Finding("python", FindingStatus.OK, detail)


def _engine(kind: EngineKind, if_missing: FindingStatus) -> Finding:
    search = search_engines(kind)
    if not search.found:
        detail = "; ".join(search.notes)
        return Finding(str(kind), if_missing, detail, hint=f"ludus engine install {kind}")
    rows = [f"{show_version(e.version)} {e.path} [{e.source}]" for e in search.found]
    return Finding(str(kind), FindingStatus.OK, "; ".join(rows))


def _template() -> Finding:
    if sys.platform != "linux":
        return Finding("template", FindingStatus.OK, "none; games are exported for Linux only")
    engine = next(iter(search_engines(EngineKind.GODOT4).found), None)
    template = matching_template(engine) if engine else None
    if template is not None:
        detail = f"{template.version_text} {template.path} [{template.source}]"
        return Finding("template", FindingStatus.OK, detail)
    others = [
        f"{other.version_text} [{other.source}]" for other in cached_templates(EngineKind.GODOT4)
    ]
    release = release_name(engine.version_text) if engine else "Godot 4"
    detail = f"none to export games with {release}; there are: {', '.join(others) or 'none'}"
    hint = "to export games: ludus engine install godot4 --templates"
    return Finding("template", FindingStatus.WARN, detail, hint)


def _cache() -> Finding:
    root = cache_root()
    if root is None:
        hint = 'pip install "ludus-rl[engine]"'
        return Finding("cache", FindingStatus.WARN, "platformdirs is not installed", hint)
    if not os.access(_first_existing(root), os.W_OK):
        hint = f"make {root} writable"
        return Finding("cache", FindingStatus.WARN, f"{root} cannot be written", hint)
    free_gb = shutil.disk_usage(_first_existing(root)).free / 1e9
    status = FindingStatus.OK if free_gb > 2 else FindingStatus.WARN
    return Finding("cache", status, f"{root}, {free_gb:.0f} GB free")


def _first_existing(path: Path) -> Path:
    return next(folder for folder in (path, *path.parents) if folder.exists())


def _cores() -> Finding:
    cores = allowed_cores()
    if cores is None:
        detail = f"{os.cpu_count()} cores; engines cannot be pinned on {sys.platform}"
        return Finding("cores", FindingStatus.WARN, detail, "several engines run faster on Linux")
    detail = f"{len(cores)} of {os.cpu_count()} cores may be used; engines are pinned"
    return Finding("cores", FindingStatus.OK, detail)


def _local_sockets() -> Finding:
    if hasattr(socket, "AF_UNIX"):
        return Finding("sockets", FindingStatus.OK, "Unix domain sockets and TCP")
    return Finding("sockets", FindingStatus.OK, "TCP (no Unix domain sockets here)")


def _screen() -> Finding:
    if sys.platform != "linux":
        return Finding("screen", FindingStatus.OK, "the system's own")
    name = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if name:
        return Finding("screen", FindingStatus.OK, f"display {name}")
    xvfb = find_xvfb()
    install = "for pictures and films: ludus engine install godot4 --rendering"
    if xvfb is None:
        hint = f"{install}, or the system's package (Debian: apt install xvfb)"
        return Finding("screen", FindingStatus.WARN, "no display and no Xvfb", hint)
    records = [record for _, record in cached_engines(EngineKind.GODOT4)]
    if records and not any(record.has_rendering for record in records):
        detail = f"{xvfb}, but the engine in the cache came without a renderer"
        return Finding("screen", FindingStatus.WARN, detail, install)
    return Finding("screen", FindingStatus.OK, f"virtual, by {xvfb}")


def _torch() -> Finding:
    if importlib.util.find_spec("torch") is None:
        hint = 'for training: pip install "ludus-rl[train]"'
        return Finding("torch", FindingStatus.WARN, "not installed", hint)
    version = importlib.metadata.version("torch")
    return Finding("torch", FindingStatus.OK, version)


def _cuda() -> Finding:
    driver = shutil.which("nvidia-smi") or next(Path("/dev").glob("nvidia[0-9]*"), None)
    if driver is None:
        return Finding("cuda", FindingStatus.OK, "no NVIDIA device; the CPU serves small networks")
    return Finding("cuda", FindingStatus.OK, f"NVIDIA driver present ({driver})")
