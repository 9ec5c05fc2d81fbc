"""Examine this machine: what is installed, and what is missing."""

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

from ludus.engine.affinity import allowed_cores, cpu_quota
from ludus.engine.cache import cache_root, cached_engines
from ludus.engine.find import search_engines
from ludus.engine.kinds import EngineKind
from ludus.engine.screen import find_xvfb
from ludus.engine.template import cached_templates, matching_template
from ludus.engine.version import release_name, show_version
from ludus.extras import install_hint

__all__ = ["Finding", "FindingStatus", "doctor"]


class FindingStatus(StrEnum):
    """How good a finding is."""

    OK = "ok"
    WARN = "warn"
    FAIL = "fail"


@dataclass(frozen=True)
class Finding:
    """The result of one check.

    Attributes:
        name: What was checked.
        status: ``warn`` limits what can be done; ``fail`` prevents running anything.
        detail: What was found.
        hint: What to do about it, if anything.
    """

    name: str
    status: FindingStatus
    detail: str
    hint: str = ""


def doctor() -> list[Finding]:
    """Examine this machine; nothing is changed, downloaded or, except for ``--version``, run."""
    has_unix_sockets = hasattr(socket, "AF_UNIX")
    return [
        _ok("python", f"{platform.python_version()} on {platform.platform()}"),
        _engine(EngineKind.GODOT4, FindingStatus.FAIL),
        _engine(EngineKind.GODOT3, FindingStatus.WARN),
        _template(),
        _cache(),
        _cores(),
        _ok("sockets", "Unix domain sockets and TCP" if has_unix_sockets else "TCP only"),
        _screen(),
        _torch(),
        _cuda(),
    ]


def _ok(name: str, detail: str) -> Finding:
    return Finding(name, FindingStatus.OK, detail)


def _warn(name: str, detail: str, hint: str = "") -> Finding:
    return Finding(name, FindingStatus.WARN, detail, hint)


def _engine(kind: EngineKind, if_missing: FindingStatus) -> Finding:
    search = search_engines(kind)
    if not search.found:
        detail = "; ".join(search.notes)
        return Finding(str(kind), if_missing, detail, hint=f"ludus engine install {kind}")
    rows = [f"{show_version(e.version)} {e.path} [{e.source}]" for e in search.found]
    return _ok(str(kind), "; ".join(rows))


def _template() -> Finding:
    if sys.platform != "linux":
        return _ok("template", "none; games are exported for Linux only")
    engine = next(iter(search_engines(EngineKind.GODOT4).found), None)
    template = matching_template(engine) if engine else None
    if template is not None:
        return _ok("template", f"{template.version_text} {template.path} [{template.source}]")
    others = [f"{other.version_text} [{other.source}]" for other in cached_templates()]
    release = release_name(engine.version_text) if engine else "Godot 4"
    return _warn(
        "template",
        f"none to export games with {release}; there are: {', '.join(others) or 'none'}",
        hint="to export games: ludus engine install godot4 --templates",
    )


def _cache() -> Finding:
    root = cache_root()
    if root is None:
        return _warn("cache", "platformdirs is not installed", install_hint("engine"))
    existing = next(folder for folder in (root, *root.parents) if folder.exists())
    if not os.access(existing, os.W_OK):
        return _warn("cache", f"{root} cannot be written", hint=f"make {root} writable")
    free_gb = shutil.disk_usage(existing).free / 1e9
    status = FindingStatus.OK if free_gb > 2 else FindingStatus.WARN
    return Finding("cache", status, f"{root}, {free_gb:.0f} GB free")


def _cores() -> Finding:
    cores = allowed_cores()
    if cores is None:
        detail = f"{os.cpu_count()} cores; engines cannot be pinned on {sys.platform}"
        return _warn("cores", detail, hint="several engines run faster on Linux")
    detail = f"{len(cores)} of {os.cpu_count()} cores may be used"
    quota = cpu_quota()
    if quota is not None and quota < len(cores):
        return _ok("cores", f"{detail}, for {quota:g} cores' worth of time; engines are not pinned")
    return _ok("cores", f"{detail}; engines are pinned where enough are free")


def _screen() -> Finding:
    if sys.platform != "linux":
        return _ok("screen", "the system's own")
    name = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if name:
        return _ok("screen", f"display {name}")
    xvfb = find_xvfb()
    install = "for pictures and films: ludus engine install godot4 --rendering"
    if xvfb is None:
        hint = f"{install}, or the system's package (Debian: apt install xvfb)"
        return _warn("screen", "no display and no Xvfb", hint)
    records = [record for _, record in cached_engines(EngineKind.GODOT4)]
    if records and not any(record.has_rendering for record in records):
        detail = (
            f"virtual, by {xvfb}; the Godot in the cache was installed without what it draws with, "
            "so windows, cameras and films work only if this machine has that"
        )
        return _warn("screen", detail, f"training without pictures needs none of it; {install}")
    return _ok("screen", f"virtual, by {xvfb}")


def _torch() -> Finding:
    if importlib.util.find_spec("torch") is None:
        return _warn("torch", "not installed", hint=f"for training: {install_hint('train')}")
    return _ok("torch", importlib.metadata.version("torch"))


def _cuda() -> Finding:
    driver = shutil.which("nvidia-smi") or next(Path("/dev").glob("nvidia[0-9]*"), None)
    if driver is None:
        return _ok("cuda", "no NVIDIA device; the CPU is enough for small networks")
    return _ok("cuda", f"NVIDIA driver present ({driver})")
