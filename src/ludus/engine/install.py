"""Install engines, export templates and Xvfb in the user cache."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ludus.engine.cache import EngineRecord, TemplateRecord, cached_engines
from ludus.engine.debian import SCREEN, debian_engine, debian_template
from ludus.engine.find import InstalledEngine
from ludus.engine.installing import (
    Installer,
    InstallerUnavailable,
    Product,
    Progress,
    Unpacked,
    install,
    no_progress,
)
from ludus.engine.kinds import EngineKind
from ludus.engine.official import official_engine, official_template
from ludus.engine.output import run_captured
from ludus.engine.screen import SCREEN_FOLDER, find_xvfb, with_virtual_screen
from ludus.engine.template import ExportTemplate, matching_template
from ludus.engine.version import ask_version, release_name, show_version
from ludus.errors import ConfigError, SetupError

__all__ = ["install_engine", "install_screen", "install_template", "template_installers"]

SCREEN_TIMEOUT_S = 30.0


def install_engine(
    kind: EngineKind,
    *,
    rendering: bool = False,
    force: bool = False,
    progress: Progress = no_progress,
    installers: Sequence[Installer] | None = None,
) -> InstalledEngine:
    """Install an engine, or return the one that is installed already.

    Args:
        kind: Which engine.
        rendering: Also install what an engine needs to open a window.
        force: Install again even if it is there.
        progress: Called with what is being done.
        installers: Tried in this order; by default the official archives, then Debian's
            packages.

    Raises:
        SetupError: No installer works here, or one failed; nothing is left behind.
    """
    if installers is None:
        installers = (official_engine(kind, rendering), debian_engine(kind, rendering))
    return install(_Engine(kind, rendering), installers, force=force, progress=progress)


def install_template(
    engine: InstalledEngine,
    *,
    force: bool = False,
    progress: Progress = no_progress,
    installers: Sequence[Installer] | None = None,
) -> ExportTemplate:
    """Install the release template that ``engine`` exports with, or return the one that is there.

    Args:
        engine: The engine; the template is of the same release.
        force: Install again even if it is there.
        progress: Called with what is being done.
        installers: Tried in this order; by default `template_installers`.

    Raises:
        ConfigError: The engine is not Godot 4.
        SetupError: No installer works here or has this release, or one failed; nothing is left
            behind.
    """
    if engine.kind is not EngineKind.GODOT4:
        raise ConfigError(f"export templates are for Godot 4, not for {engine.kind.traits.label}")
    if installers is None:
        installers = template_installers(engine)
    return install(_Template(engine), installers, force=force, progress=progress)


def template_installers(engine: InstalledEngine) -> tuple[Installer, Installer]:
    """Return the installers of an engine's template: the official archive, Debian's package."""
    return official_template(release_name(engine.version_text)), debian_template()


def install_screen(*, force: bool = False, progress: Progress = no_progress) -> Path:
    """Install Xvfb, or return the one that is on ``PATH`` or was installed already.

    Args:
        force: Install again even if it is there.
        progress: Called with what is being done.

    Raises:
        SetupError: This machine has no apt, or the installation failed; nothing is left behind.
    """
    return install(_Screen(), [SCREEN], force=force, progress=progress)


@dataclass
class _Engine(Product[InstalledEngine]):
    kind: EngineKind
    rendering: bool

    def __post_init__(self) -> None:
        self.label = self.kind.traits.label
        self.folder = f"engines/{self.kind}"
        variable = self.kind.traits.environment_variable
        self.hint = (
            "connect to the network and try again, or install it yourself and set "
            f"{variable} to the executable"
        )

    def find(self) -> InstalledEngine | None:
        for folder, record in cached_engines(self.kind):
            if self.kind.accepts(record.version) and (record.has_rendering or not self.rendering):
                return InstalledEngine.from_cache(self.kind, folder, record)
        return None

    def try_out(self, installer: str, folder: Path, unpacked: Unpacked) -> str:
        answer = ask_version(unpacked.program)
        if answer is None:
            variable = self.kind.traits.environment_variable
            raise SetupError(
                f"the {self.label} installed by {installer} does not start",
                hint=f"install it yourself and set {variable} to the executable",
            )
        version, text = answer
        if not self.kind.accepts(version):
            raise SetupError(f"{installer} installed {text}; {self.kind.traits.requirement}")
        EngineRecord(
            version=version,
            version_text=text,
            route=installer,
            has_rendering=unpacked.has_rendering,
            executable=unpacked.program.relative_to(folder).as_posix(),
            window_executable=unpacked.window_program.relative_to(folder).as_posix(),
        ).write(folder)
        suffix = "-rendering" if unpacked.has_rendering else ""
        return f"{show_version(version)}-{installer}{suffix}"

    def describe(self, folder: Path) -> InstalledEngine:
        return InstalledEngine.from_cache(self.kind, folder, EngineRecord.read(folder))


@dataclass
class _Template(Product[ExportTemplate]):
    engine: InstalledEngine

    def __post_init__(self) -> None:
        engine = self.engine
        self.label = f"an export template for {engine.path} ({engine.version_text})"
        self.folder = f"templates/{engine.kind}"
        self.hint = (
            f"ludus engine install {engine.kind} --templates --force installs engine and template "
            "of one release; or use Editor > Manage Export Templates"
        )

    def find(self) -> ExportTemplate | None:
        return matching_template(self.engine)

    def try_out(self, installer: str, folder: Path, unpacked: Unpacked) -> str:
        answer = ask_version(unpacked.program)
        if answer is None:
            raise SetupError(f"the export template installed by {installer} does not start")
        release = release_name(self.engine.version_text)
        if release_name(answer[1]) != release:
            raise InstallerUnavailable(f"its template is {answer[1]}, expected {release}")
        prefix = unpacked.prefix
        TemplateRecord(
            version_text=answer[1],
            route=installer,
            executable=unpacked.executable.relative_to(folder).as_posix(),
            prefix="" if prefix is None else prefix.relative_to(folder).as_posix(),
        ).write(folder)
        return f"{release}-{installer}"

    def describe(self, folder: Path) -> ExportTemplate:
        return ExportTemplate.from_cache(folder, TemplateRecord.read(folder))


class _Screen(Product[Path]):
    label = "Xvfb"
    folder = SCREEN_FOLDER
    hint = "install it yourself (Debian: apt install xvfb)"

    def find(self) -> Path | None:
        return find_xvfb()

    def try_out(self, installer: str, folder: Path, unpacked: Unpacked) -> str:
        try:
            done = run_captured(with_virtual_screen(("true",), unpacked.program), SCREEN_TIMEOUT_S)
        except subprocess.TimeoutExpired as error:
            raise SetupError(
                f"the installed Xvfb did not start within {SCREEN_TIMEOUT_S:.0f} s"
            ) from error
        if done.returncode != 0:
            raise SetupError(f"the installed Xvfb does not start:\n{done.stdout}")
        return f"xvfb-{installer}"

    def describe(self, folder: Path) -> Path:
        return folder / "Xvfb"
