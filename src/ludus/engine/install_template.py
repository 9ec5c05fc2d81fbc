"""Install the export template of an engine in the user cache."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ludus.engine.cache import require_cache_root
from ludus.engine.debian_template import DebianTemplateRoute
from ludus.engine.find import InstalledEngine
from ludus.engine.incoming import installing_into, move_in, unpack_by_first_route
from ludus.engine.kinds import EngineKind
from ludus.engine.official_template import OfficialTemplateRoute
from ludus.engine.routes import (
    Progress,
    RouteUnavailable,
    TemplateRoute,
    UnpackedTemplate,
    no_progress,
)
from ludus.engine.template import ExportTemplate, TemplateRecord, matching_template
from ludus.engine.version import ask_version, release_name
from ludus.errors import ConfigError, SetupError

__all__ = ["install_template"]


def install_template(
    engine: InstalledEngine,
    *,
    force: bool = False,
    progress: Progress = no_progress,
    routes: Sequence[TemplateRoute] = (OfficialTemplateRoute(), DebianTemplateRoute()),
) -> ExportTemplate:
    """Install the release template that ``engine`` exports with, or return the one that is there.

    Args:
        engine: The engine; the template is of the same release.
        force: Install again even if it is there.
        progress: Called with what is being done.
        routes: Ways to try, in this order; by default the official archive, then Debian's
            package.

    Raises:
        ConfigError: The engine is not Godot 4.
        SetupError: No route works here or has this release, or one failed; nothing is left
            behind.
    """
    if engine.kind is not EngineKind.GODOT4:
        raise ConfigError(f"export templates are for Godot 4, not for {engine.kind.traits.label}")
    folder = require_cache_root() / "templates" / engine.kind
    with installing_into(folder, "the export template"):
        present = None if force else matching_template(engine)
        return present or _install(engine, folder, routes, progress)


def _install(
    engine: InstalledEngine, folder: Path, routes: Sequence[TemplateRoute], progress: Progress
) -> ExportTemplate:
    release = release_name(engine.version_text)

    def unpack(route: TemplateRoute, incoming: Path) -> ExportTemplate:
        unpacked = route.unpack_template(release, incoming, progress=progress)
        record = _try_out(release, incoming, route.name, unpacked)
        target = move_in(incoming, folder / f"{release}-{route.name}")
        return ExportTemplate.from_cache(target, record)

    failure = SetupError(
        f"no export template for {engine.path}, which is {engine.version_text}, could be installed",
        hint=f"ludus engine install {engine.kind} --templates --force brings engine and template "
        "of one release; or use Editor > Manage Export Templates",
    )
    return unpack_by_first_route(routes, folder, unpack, failure)


def _try_out(
    release: str, incoming: Path, route_name: str, unpacked: UnpackedTemplate
) -> TemplateRecord:
    """Run the template once, and record what it is."""
    answer = ask_version(unpacked.runnable)
    if answer is None:
        raise SetupError(f"the export template installed by route {route_name} does not start")
    if release_name(answer[1]) != release:
        raise RouteUnavailable(f"its template is {answer[1]}, expected {release}")
    prefix = unpacked.prefix
    record = TemplateRecord(
        version_text=answer[1],
        route=route_name,
        executable=unpacked.executable.relative_to(incoming).as_posix(),
        prefix="" if prefix is None else prefix.relative_to(incoming).as_posix(),
    )
    record.write(incoming)
    return record
