"""``ludus addon``: install the Ludus add-on in a game."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from ludus.errors import ConfigError

if TYPE_CHECKING:
    from ludus.addon import AddonChange

__all__ = ["COMMAND", "RENAMED_FLAGS", "run"]


@dataclass(frozen=True)
class Install:
    """Copy the add-on into a project, or upgrade it there, and enable it.

    Attributes:
        project: Folder of the project.
        force: Overwrite files of the add-on that were changed by hand.
        legacy: For games written for Godot RL Agents or godot-ai or, in Godot 3, for GymGodot or
            godot_gym_api: also install the classes of that legacy bridge, and back up the files
            that they replace.
        undo: With --legacy, in Godot 4: put back the files that were backed up, and remove those
            classes. The add-on itself stays.
    """

    project: tyro.conf.Positional[Path]
    force: bool = False
    legacy: bool = False
    undo: bool = False


@dataclass(frozen=True)
class Status:
    """Show whether a project has the add-on, and whether it is enabled, current and unchanged.

    Attributes:
        project: Folder of the project.
    """

    project: tyro.conf.Positional[Path]


@dataclass(frozen=True)
class Environment:
    """Make a virtual environment, .venv, in a project, with this very Ludus.

    If it fails or is interrupted, nothing is left of it.

    Attributes:
        project: Folder of the project.
        size: Print only how large it will be.
    """

    project: tyro.conf.Positional[Path]
    size: bool = False


COMMAND: Any = (
    Annotated[Install, tyro.conf.subcommand("install")]
    | Annotated[Environment, tyro.conf.subcommand("environment")]
    | Annotated[Status, tyro.conf.subcommand("status")]
)
RENAMED_FLAGS = {"--classic": "--legacy", "--no-classic": "--no-legacy"}


def run(command: Install | Environment | Status) -> int:
    """Run the subcommand; return the exit code."""
    if isinstance(command, Environment):
        return _make_environment(command)
    return _install(command) if isinstance(command, Install) else _status(command)


def _install(command: Install) -> int:
    from ludus.addon import install_addon
    from ludus.addon.environment import remember_installer
    from ludus.addon.new_project import add_script_templates
    from ludus.engine.project import find_project

    if command.undo:
        return _undo_legacy_addon(command)
    if command.legacy:
        _install_legacy_addon(command)
    else:
        _print_change("ludus add-on", install_addon(command.project, force=command.force))
    for path in add_script_templates(find_project(command.project)):
        what = "a template for your scripts"
        if path.endswith(".gdignore"):
            what = "keeps Godot from importing the templates"
        sys.stdout.write(f"  new: {path} ({what})\n")
    remember_installer()
    return 0


def _make_environment(command: Environment) -> int:
    from ludus.addon.environment import make_environment, measure_environment

    megabytes = measure_environment() / 1e6
    sys.stdout.write(f"{command.project / '.venv'} takes about {megabytes:.0f} MB\n")
    if not command.size:
        sys.stdout.write(f"made: {make_environment(command.project)}\n")
    return 0


def _install_legacy_addon(command: Install) -> None:
    from ludus.legacy.addon import install_legacy_addon

    change = install_legacy_addon(command.project, force=command.force)
    _print_change("ludus add-on", change.addon)
    _print_change(change.folder.removeprefix("addons/"), change.legacy)
    for path in change.replaced:
        sys.stdout.write(f"  replaced: {path} (kept in {change.kept})\n")
    for path in change.without_action:
        text = "set discrete_n or continuous_size on its GymGodot node, as in Python"
        sys.stdout.write(f"  {path}: {text}\n")


def _undo_legacy_addon(command: Install) -> int:
    from ludus.legacy.addon import undo_legacy_addon

    if not command.legacy:
        raise ConfigError("--undo undoes an installation with --legacy", hint="add --legacy")
    for path in undo_legacy_addon(command.project, force=command.force):
        sys.stdout.write(f"put back: {path}\n")
    sys.stdout.write("the Ludus add-on is still installed\n")
    return 0


def _print_change(name: str, change: AddonChange) -> None:
    what = "installed" if change.version_before is None else f"was {change.version_before}"
    counts = (
        f"{len(change.added)} new, {len(change.updated)} updated, {len(change.removed)} removed"
    )
    sys.stdout.write(f"{name} {change.version_after} ({what}): {counts}\n")
    for path in change.rewritten:
        sys.stdout.write(f"  rewritten: {path} (paths or names of the add-on have changed)\n")


def _status(command: Status) -> int:
    from ludus.addon import addon_status

    status = addon_status(command.project)
    if not status.is_present:
        sys.stdout.write("the project has no Ludus add-on\n")
        return 1
    words = [
        f"version {status.version or 'unknown'}",
        "enabled" if status.is_enabled else "not enabled",
        "current" if status.is_current else "not the version of this Ludus",
    ]
    sys.stdout.write(f"ludus add-on: {', '.join(words)}\n")
    for path in status.changed:
        sys.stdout.write(f"  changed: {path}\n")
    return 0
