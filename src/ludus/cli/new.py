"""``ludus new``: make a small project that trains at once."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

__all__ = ["COMMAND", "NewCommand", "run"]


@dataclass(frozen=True)
class NewCommand:
    """Make a project with a small game and an agent, ready to train, for Godot 4 or Bevy.

    Attributes:
        folder: Folder to create; the project gets its name.
        is_2d: A game in 2D: a player collects coins. The default.
        is_3d: The same in 3D.
        simulation: A game in one script, without nodes, for many worlds.
        bevy: A game for Bevy: a Cargo package.
    """

    folder: tyro.conf.Positional[Path]
    is_2d: Annotated[bool, tyro.conf.arg(name="2d")] = False
    is_3d: Annotated[bool, tyro.conf.arg(name="3d")] = False
    simulation: bool = False
    bevy: bool = False


COMMAND = NewCommand


def run(command: NewCommand) -> int:
    """Make the project; return the exit code."""
    from ludus.addon.environment import remember_installer
    from ludus.addon.new_project import ProjectKind, make_project
    from ludus.errors import UsageError

    given = {
        ProjectKind.TWO_D: command.is_2d,
        ProjectKind.THREE_D: command.is_3d,
        ProjectKind.SIMULATION: command.simulation,
        ProjectKind.BEVY: command.bevy,
    }
    chosen = [kind for kind, is_given in given.items() if is_given] or [ProjectKind.TWO_D]
    if len(chosen) > 1:
        named = " and ".join(f"--{kind}" for kind in chosen)
        raise UsageError(f"{named} exclude each other", "choose one of them")
    folder = make_project(command.folder, chosen[0])
    if chosen[0] is not ProjectKind.BEVY:
        remember_installer()
    sys.stdout.write(f"made {folder}; now: ludus train {folder}\n")
    return 0
