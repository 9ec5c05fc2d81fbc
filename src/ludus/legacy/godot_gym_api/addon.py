"""Let a project that was written for godot_gym_api use our classes of the same names.

Its five scripts are put aside. Where each stood, a script of one line stands for ours, for scenes
and scripts that name its path; the project's list of classes names ours.
"""

from __future__ import annotations

from pathlib import Path

from ludus.addon import LEGACY_PATH, read_project_file, write_project_file
from ludus.engine.kinds import EngineKind
from ludus.engine.script_classes import find_script_classes, move_script_classes
from ludus.errors import ConfigError, SetupError
from ludus.legacy.addon_files import declared_classes, own_classes

__all__ = ["KEPT_PATH", "godot_gym_api_stand_ins", "list_own_classes"]

KEPT_PATH = "godot_gym_api.old"
"""Where replaced files are kept; Godot does not look into it."""

_ROOT_CLASS, _ROOT_SCRIPT = "RLEnvironment", "rl_environment.gd"
_STAND_IN = """\
extends "res://{path}"
# Stands where a script of godot_gym_api stood, for scenes and scripts that name its path.
# Made by `ludus addon install --legacy`, which keeps that script in {kept}.
"""


def godot_gym_api_stand_ins(root: Path) -> dict[Path, str]:
    """Return what takes the places of godot_gym_api's scripts.

    Raises:
        ConfigError: The game has a class of one of our names, which is not godot_gym_api's.
    """
    ours = own_classes(EngineKind.GODOT3)
    theirs = {name: file for name, file in declared_classes(root) if name in ours}
    if theirs and getattr(theirs.get(_ROOT_CLASS), "name", "") != _ROOT_SCRIPT:
        raise _foreign_classes(root, theirs)
    # The root class comes last: until then a repetition knows whose the others are.
    names = sorted(theirs, key=lambda name: name == _ROOT_CLASS)
    return {theirs[name]: _STAND_IN.replace("{path}", ours[name]) for name in names}


def list_own_classes(root: Path) -> None:
    """Let ``project.godot`` list our scripts under the names that both have.

    Raises:
        SetupError: It cannot be written.
    """
    text = read_project_file(root)
    ours = find_script_classes(root / LEGACY_PATH, f"res://{LEGACY_PATH}")
    moved = move_script_classes(text, ours)
    if moved == text:
        return
    try:
        write_project_file(root, moved)
    except OSError as error:
        raise SetupError(
            f"the classes could not be listed in the project file of {root}: {error}",
            hint="the project folder must be writable, and the disk not full",
        ) from error


def _foreign_classes(root: Path, theirs: dict[str, Path]) -> ConfigError:
    """Class names are unique: beside godot_gym_api's root class, all of these are its own."""
    rows = "\n".join(f"  {name}: {file.relative_to(root)}" for name, file in theirs.items())
    return ConfigError(
        f"the game has classes of these names, which the add-on brings, too:\n{rows}",
        hint=f"rename them; they are not taken for godot_gym_api's, as there is no {_ROOT_CLASS} "
        f"in a {_ROOT_SCRIPT}",
    )
