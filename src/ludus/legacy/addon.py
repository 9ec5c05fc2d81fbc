"""Let a project that was written for another add-on use ours in its place.

In Godot 4 that is godot-ai: the files that declare its classes are put aside. Where each stood, a
script of one line stands for it, so that scenes and scripts that name its path, or its UID, find
it. In Godot 3 the same is done for GymGodot (:mod:`ludus.legacy.gymgodot.addon`) and godot_gym_api
(:mod:`ludus.legacy.godot_gym_api.addon`).
"""

from __future__ import annotations

from pathlib import Path

from ludus.addon import LEGACY_PATH, install_addon, install_folder
from ludus.engine.kinds import EngineKind
from ludus.engine.project import find_project
from ludus.errors import ConfigError
from ludus.legacy.addon_files import LegacyChange, declared_classes, own_classes, put_aside
from ludus.legacy.godot_gym_api.addon import KEPT_PATH as GODOT_GYM_API_KEPT_PATH
from ludus.legacy.godot_gym_api.addon import godot_gym_api_stand_ins, list_own_classes
from ludus.legacy.gymgodot.addon import KEPT_PATH as GYMGODOT_KEPT_PATH
from ludus.legacy.gymgodot.addon import gymgodot_stand_ins, scenes_without_action

__all__ = ["KEPT_PATH", "LegacyChange", "install_legacy_addon"]

KEPT_PATH = "godot-ai.old"
"""Where replaced files are kept; Godot does not look into it."""

_ROOT_CLASS = "AIBaseEnvironment"
_STAND_IN = """\
extends "res://{path}"
## Stands where a file of godot-ai stood, for scenes and scripts that name its path.
## Made by `ludus addon install --legacy`, which keeps that file in {kept}.
"""


def install_legacy_addon(project: Path, *, force: bool = False) -> LegacyChange:
    """Install the add-on with the classes of others' names, in the place of their own.

    Repeating it changes nothing.

    Args:
        project: Folder of the project, or anything inside it.
        force: Overwrite files of the add-on that were changed by hand.

    Raises:
        TargetError: There is no Godot project.
        ConfigError: Files of the add-on were changed by hand, or a class of the game has a name
            that the add-on needs.
        SetupError: The project cannot be written.
    """
    found = find_project(project)
    if found.engine_kind is EngineKind.GODOT3:
        return _install_in_godot3(found.root, force=force)
    return _install_for_godot_ai(found.root, force=force)


def _install_for_godot_ai(root: Path, *, force: bool) -> LegacyChange:
    ours = own_classes(EngineKind.GODOT4)
    theirs = {name: file for name, file in declared_classes(root) if name in ours}
    _refuse_foreign_classes(root, theirs)
    addon = install_addon(root, force=force)
    legacy = install_folder(root, LEGACY_PATH, force=force)
    if not theirs:
        return LegacyChange(addon, legacy)
    # The root class comes last: until then a repetition knows whose the others are.
    stand_ins = {
        theirs[name]: _STAND_IN.replace("{path}", ours[name])
        for name in sorted(theirs, key=lambda name: name == _ROOT_CLASS)
    }
    kept = put_aside(root, stand_ins, KEPT_PATH)
    names = sorted(file.relative_to(root).as_posix() for file in theirs.values())
    return LegacyChange(addon, legacy, tuple(names), kept)


def _install_in_godot3(root: Path, *, force: bool) -> LegacyChange:
    theirs = godot_gym_api_stand_ins(root)
    legacy = install_folder(root, LEGACY_PATH, force=force)
    addon = install_addon(root, force=force)
    list_own_classes(root)
    stand_ins = {**gymgodot_stand_ins(root), **theirs}
    kept_path = GODOT_GYM_API_KEPT_PATH if theirs else GYMGODOT_KEPT_PATH
    kept = put_aside(root, stand_ins, kept_path) if stand_ins else ""
    names = tuple(sorted(file.relative_to(root).as_posix() for file in stand_ins))
    return LegacyChange(addon, legacy, names, kept, scenes_without_action(root))


def _refuse_foreign_classes(root: Path, theirs: dict[str, Path]) -> None:
    """Class names are unique: beside godot-ai's root class, all of these are godot-ai's."""
    if not theirs or _ROOT_CLASS in theirs:
        return
    rows = "\n".join(f"  {name}: {file.relative_to(root)}" for name, file in theirs.items())
    raise ConfigError(
        f"the game has classes of these names, which the classes of godot-ai need:\n{rows}",
        hint=f"rename them; they are not taken for godot-ai's, as there is no {_ROOT_CLASS}",
    )
