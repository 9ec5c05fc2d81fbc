"""Install an engine in the user cache: all of it or nothing, and once."""

from __future__ import annotations

import errno
import logging
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path

from ludus.engine.cache import CacheRecord, cached_records, require_cache_root
from ludus.engine.debian import DebianRoute
from ludus.engine.find import InstalledEngine
from ludus.engine.kinds import EngineKind
from ludus.engine.locks import file_lock
from ludus.engine.official import OfficialRoute
from ludus.engine.routes import Progress, Route, RouteUnavailable, UnpackedEngine
from ludus.engine.version import ask_version, show_version
from ludus.errors import SetupError

__all__ = ["install_engine"]

LOCK_TIMEOUT_S = 1200.0

_INCOMING = ".incoming-"
_log = logging.getLogger(__name__)


def install_engine(
    kind: EngineKind,
    *,
    rendering: bool = False,
    force: bool = False,
    progress: Progress | None = None,
    routes: Sequence[Route] | None = None,
) -> InstalledEngine:
    """Install an engine, or return the one that is installed already.

    Everything is unpacked in a folder that nothing takes for an engine, tried out, and renamed
    at the end. A lock lets only one process install one kind at a time; the others wait and
    use what it installed.

    Args:
        kind: Which engine.
        rendering: Also install what opening a window takes.
        force: Install again even if it is there.
        progress: Called with what is being done.
        routes: Ways to try, in this order; by default the official archives, then Debian's
            packages.

    Raises:
        SetupError: No route works here, or one failed; nothing is left behind.
    """
    progress = progress or _no_progress
    routes = (OfficialRoute(), DebianRoute()) if routes is None else routes
    folder = require_cache_root() / "engines" / kind
    try:
        with file_lock(folder / ".install.lock", LOCK_TIMEOUT_S):
            _remove_broken_off(folder)
            present = None if force else _installed(kind, rendering=rendering)
            return present or _install(kind, folder, routes, rendering, progress)
    except OSError as error:
        raise _disk_error(error, folder) from error


def _no_progress(_what: str, _fraction: float | None) -> None:
    pass


def _remove_broken_off(folder: Path) -> None:
    """Remove what installations left that were killed; the caller holds the lock."""
    for leftover in folder.glob(f"{_INCOMING}*"):
        shutil.rmtree(leftover, ignore_errors=True)


def _installed(kind: EngineKind, *, rendering: bool) -> InstalledEngine | None:
    for folder, record in cached_records(kind):
        if kind.accepts(record.version) and (record.has_rendering or not rendering):
            return InstalledEngine.from_cache(kind, folder, record)
    return None


def _install(
    kind: EngineKind, folder: Path, routes: Sequence[Route], rendering: bool, progress: Progress
) -> InstalledEngine:
    refused: list[str] = []
    for route in routes:
        incoming = Path(tempfile.mkdtemp(prefix=_INCOMING, dir=folder))
        try:
            unpacked = route.unpack(kind, incoming, rendering=rendering, progress=progress)
            record = _try_out(kind, incoming, route.name, unpacked)
            return InstalledEngine.from_cache(kind, _move_in(incoming, folder, record), record)
        except RouteUnavailable as reason:
            _log.info("route %s: %s", route.name, reason)
            refused.append(f"  {route.name}: {reason}")
        finally:
            shutil.rmtree(incoming, ignore_errors=True)
    raise SetupError(
        f"{kind.traits.label} could not be installed:\n" + "\n".join(refused),
        hint="connect to the network and try again, or install it yourself and set "
        f"{kind.traits.environment_variable} to the executable",
    )


def _try_out(
    kind: EngineKind, incoming: Path, route_name: str, unpacked: UnpackedEngine
) -> CacheRecord:
    """Run the engine once, and record what it is."""
    answer = ask_version(unpacked.executable)
    if answer is None:
        raise SetupError(
            f"the {kind.traits.label} installed by route {route_name} does not start",
            hint=f"install it yourself and set {kind.traits.environment_variable}",
        )
    version, text = answer
    if not kind.accepts(version):
        raise SetupError(
            f"route {route_name} brought {text}; {kind.traits.label} needs "
            f"{show_version(kind.traits.minimum_version)} or newer"
        )
    record = CacheRecord(
        version=version,
        version_text=text,
        route=route_name,
        has_rendering=unpacked.has_rendering,
        executable=unpacked.executable.relative_to(incoming).as_posix(),
        window_executable=unpacked.window_executable.relative_to(incoming).as_posix(),
    )
    record.write(incoming)
    return record


def _move_in(incoming: Path, folder: Path, record: CacheRecord) -> Path:
    suffix = "-rendering" if record.has_rendering else ""
    target = folder / f"{show_version(record.version)}-{record.route}{suffix}"
    if target.exists():
        old = Path(tempfile.mkdtemp(prefix=_INCOMING, dir=folder))
        target.rename(old / "replaced")
        incoming.rename(target)
        shutil.rmtree(old, ignore_errors=True)
    else:
        incoming.rename(target)
    target.chmod(0o755)
    return target


def _disk_error(error: OSError, folder: Path) -> SetupError:
    if error.errno in {errno.ENOSPC, errno.EDQUOT}:
        hint = f"free about 1.5 GB on the disk of {folder}"
    else:
        hint = f"make sure that {folder} can be written"
    return SetupError(f"the engine could not be installed: {error}", hint=hint)
