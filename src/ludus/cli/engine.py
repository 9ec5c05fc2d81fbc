"""``ludus engine``: install, list and check game engines."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from ludus.errors import SetupError

if TYPE_CHECKING:
    from ludus.engine import ExportTemplate, InstalledEngine

__all__ = ["COMMAND", "run"]

KindName = Literal["godot4", "godot3"]


@dataclass(frozen=True)
class Install:
    """Install an engine in the user's cache, unless the cache has a usable one.

    Attributes:
        kind: Which engine.
        rendering: Also install what the engine needs to draw: a renderer and, on a Linux machine
            without a screen, Xvfb.
        templates: Also install the template for exporting games for Linux (Godot 4 only).
        force: Install again, even if the cache has a usable one.
    """

    kind: tyro.conf.Positional[KindName] = "godot4"
    rendering: bool = False
    templates: bool = False
    force: bool = False


@dataclass(frozen=True)
class List:
    """List the usable engines on this machine.

    Attributes:
        json: Print one JSON list on stdout.
    """

    json: bool = False


@dataclass(frozen=True)
class Doctor:
    """Check this machine and report what is missing; exits with 1 if no game can run.

    Attributes:
        json: Print one JSON list on stdout.
    """

    json: bool = False


COMMAND: Any = (
    Annotated[Install, tyro.conf.subcommand("install")]
    | Annotated[List, tyro.conf.subcommand("list")]
    | Annotated[Doctor, tyro.conf.subcommand("doctor")]
)


def run(command: Install | List | Doctor) -> int:
    """Run the subcommand; return the exit code."""
    if isinstance(command, Install):
        return _install(command)
    return _list(command) if isinstance(command, List) else _doctor(command)


def _install(command: Install) -> int:
    from ludus.engine import (
        EngineKind,
        has_screen,
        install_engine,
        install_screen,
        install_template,
    )

    shown: set[str] = set()

    def show(stage: str, _: float | None) -> None:
        if stage not in shown:
            shown.add(stage)
            sys.stderr.write(f"{stage}\n")

    kind, force = EngineKind(command.kind), command.force
    engine = install_engine(kind, rendering=command.rendering, force=force, progress=show)
    sys.stdout.write(f"{engine.kind} {engine.version_text}: {engine.path}\n")
    if command.rendering and not has_screen():
        try:
            sys.stdout.write(f"Xvfb: {install_screen(force=force, progress=show)}\n")
        except SetupError as error:  # the engine can still draw on a real screen
            sys.stderr.write(f"warning: {error}\n")
    if command.templates:
        template = install_template(engine, force=force, progress=show)
        sys.stdout.write(f"export template {template.version_text}: {template.path}\n")
    return 0


def _list(command: List) -> int:
    from ludus.engine import list_engines, matching_template

    rows = [(engine, matching_template(engine)) for engine in list_engines()]
    if command.json:
        sys.stdout.write(json.dumps([_to_json(*row) for row in rows]) + "\n")
        return 0
    for engine, template in rows:
        sys.stdout.write(
            f"{engine.kind}  {engine.version_text}  {engine.path}  ({engine.source})\n"
        )
        if template is not None:
            sys.stdout.write(f"  export template  {template.path}  ({template.source})\n")
    if not rows:
        sys.stderr.write("no engine found\nhint: ludus engine install godot4\n")
    return 0


def _to_json(engine: InstalledEngine, template: ExportTemplate | None) -> dict[str, str | None]:
    return {
        "kind": str(engine.kind),
        "version": engine.version_text,
        "path": str(engine.path),
        "source": engine.source,
        "template": None if template is None else str(template.path),
    }


def _doctor(command: Doctor) -> int:
    from ludus.engine import FindingStatus, doctor

    findings = doctor()
    if command.json:
        sys.stdout.write(json.dumps([asdict(finding) for finding in findings]) + "\n")
    else:
        for found in findings:
            hint = f"\n      hint: {found.hint}" if found.hint else ""
            sys.stdout.write(f"{found.status.upper():<5} {found.name}: {found.detail}{hint}\n")
    return int(any(finding.status is FindingStatus.FAIL for finding in findings))
