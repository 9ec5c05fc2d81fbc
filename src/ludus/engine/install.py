"""Install an engine in the user cache."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ludus.engine.cache import CacheRecord, cached_records, require_cache_root
from ludus.engine.debian import DebianRoute
from ludus.engine.find import InstalledEngine
from ludus.engine.incoming import installing_into, move_in, unpack_by_first_route
from ludus.engine.kinds import EngineKind
from ludus.engine.official import OfficialRoute
from ludus.engine.routes import Progress, Route, UnpackedEngine, no_progress
from ludus.engine.version import ask_version, show_version
from ludus.errors import SetupError

__all__ = ["install_engine"]


def install_engine(
    kind: EngineKind,
    *,
    rendering: bool = False,
    force: bool = False,
    progress: Progress = no_progress,
    routes: Sequence[Route] = (OfficialRoute(), DebianRoute()),
) -> InstalledEngine:
    """Install an engine, or return the one that is installed already.

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
    folder = require_cache_root() / "engines" / kind
    with installing_into(folder, kind.traits.label):
        present = None if force else _installed(kind, rendering=rendering)
        return present or _install(kind, folder, routes, rendering, progress)


def _installed(kind: EngineKind, *, rendering: bool) -> InstalledEngine | None:
    for folder, record in cached_records(kind):
        if kind.accepts(record.version) and (record.has_rendering or not rendering):
            return InstalledEngine.from_cache(kind, folder, record)
    return None


def _install(
    kind: EngineKind, folder: Path, routes: Sequence[Route], rendering: bool, progress: Progress
) -> InstalledEngine:
    def unpack(route: Route, incoming: Path) -> InstalledEngine:
        unpacked = route.unpack(kind, incoming, rendering=rendering, progress=progress)
        record = _try_out(kind, incoming, route.name, unpacked)
        target = move_in(incoming, folder / _folder_name(record))
        return InstalledEngine.from_cache(kind, target, record)

    failure = SetupError(
        f"{kind.traits.label} could not be installed",
        hint="connect to the network and try again, or install it yourself and set "
        f"{kind.traits.environment_variable} to the executable",
    )
    return unpack_by_first_route(routes, folder, unpack, failure)


def _folder_name(record: CacheRecord) -> str:
    suffix = "-rendering" if record.has_rendering else ""
    return f"{show_version(record.version)}-{record.route}{suffix}"


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
