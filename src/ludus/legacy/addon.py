"""Let a project that was written for another add-on use ours in its place.

The files that declare the other add-on's classes are backed up. In the place of each comes a script
of one line that extends ours, so that scenes and scripts that name its path, or its UID, find it.
In Godot 4 the other add-on is Godot RL Agents or godot-ai, in Godot 3 godot_gym_api or GymGodot.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ludus.addon import (
    GDRL_PATH,
    LEGACY_PATH,
    AddonChange,
    install_addon,
    install_folder,
    read_project_file,
    remove_folder,
    write_project_file,
)
from ludus.engine.kinds import EngineKind
from ludus.engine.project import find_project
from ludus.engine.script_classes import find_script_classes, move_script_classes
from ludus.errors import ConfigError, SetupError
from ludus.legacy.addon_files import (
    back_up,
    declared_classes,
    find_backup,
    is_forwarding,
    names_class,
    own_classes,
    refuse_changed,
    restore,
)
from ludus.legacy.gdrl.addon import forwarding_scripts as gdrl_scripts
from ludus.legacy.gymgodot.addon import SCRIPT as GYMGODOT_SCRIPT
from ludus.legacy.gymgodot.addon import gymgodot_scripts, scenes_without_action

__all__ = ["LegacyChange", "install_legacy_addon", "undo_legacy_addon"]


@dataclass(frozen=True)
class LegacyChange:
    """What an installation did.

    Attributes:
        addon: To the add-on.
        legacy: To the folder with the classes that legacy games name.
        folder: That folder, relative to the project.
        replaced: Files of the other add-on that were backed up, relative to the project.
        kept: Folder of the backup, relative to the project; empty if there is none.
        without_action: Scenes with a node of GymGodot that does not say what an action is.
    """

    addon: AddonChange
    legacy: AddonChange
    folder: str = LEGACY_PATH
    replaced: tuple[str, ...] = ()
    kept: str = ""
    without_action: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Original:
    """An add-on whose classes ours can replace.

    Attributes:
        name: Of the project that it comes from.
        root_class: Where a game has this class, all of the same names are the add-on's.
        root_script: Name of the file that declares it; empty: any.
    """

    name: str
    root_class: str
    root_script: str = ""


_ORIGINALS = {
    EngineKind.GODOT4: _Original("godot-ai", "AIBaseEnvironment"),
    EngineKind.GODOT3: _Original("godot_gym_api", "RLEnvironment", "rl_environment.gd"),
}
_GDRL_BACKUP = "godot_rl_agents.old"
_UNDOABLE = {_GDRL_BACKUP: GDRL_PATH, "godot-ai.old": LEGACY_PATH}
"""Folder of a backup, by that of our classes."""
_FORWARDING_SCRIPT = """\
extends "res://{path}"
# In the place of a script of {name}, for scenes and scripts that name its path.
# Made by `ludus addon install --legacy`, which keeps that script in {kept}.
"""


def install_legacy_addon(project: Path, *, force: bool = False) -> LegacyChange:
    """Install the add-on, and its classes in the place of another add-on's.

    Repeating it changes nothing.

    Args:
        project: Folder of the project, or anything inside it.
        force: Overwrite files of the add-on that were changed by hand.

    Raises:
        TargetError: There is no Godot project.
        ConfigError: The game was written for none of the bridges, files of the add-on were changed
            by hand, or a class of the game has a name that the add-on needs.
        SetupError: The project cannot be written.
    """
    found = find_project(project)
    root, is_godot3 = found.root, found.engine_kind is EngineKind.GODOT3
    if not is_godot3 and (scripts := gdrl_scripts(root)):
        return _install_for_gdrl(root, scripts, force=force)
    original = _ORIGINALS[found.engine_kind]
    scripts = _forwarding_scripts(root, found.engine_kind, original)
    if not scripts and not (root / LEGACY_PATH).exists():
        _require_legacy_game(root, found.engine_kind)
    legacy = install_folder(root, LEGACY_PATH, force=force)
    addon = install_addon(root, force=force)
    name = original.name if scripts else "gymgodot"
    if is_godot3:
        _list_own_classes(root)
        forward = _forwarding_script("GymGodot", GYMGODOT_SCRIPT)
        scripts = dict.fromkeys(gymgodot_scripts(root), forward) | scripts
    kept = back_up(root, scripts, f"{name}.old") if scripts else ""
    names = tuple(sorted(file.relative_to(root).as_posix() for file in scripts))
    without_action = scenes_without_action(root) if is_godot3 else ()
    return LegacyChange(addon, legacy, LEGACY_PATH, names, kept, without_action)


def undo_legacy_addon(project: Path, *, force: bool = False) -> tuple[str, ...]:
    """Put back the files that :func:`install_legacy_addon` replaced, and remove our classes.

    The add-on itself stays.

    Args:
        project: Folder of the project, or anything inside it.
        force: Remove our classes though they were changed by hand, and put files back though
            others are in their places.

    Returns:
        The files that were put back, relative to the project.

    Raises:
        TargetError: There is no Godot project.
        ConfigError: There is no backup, it is a Godot 3 project, or files were changed since.
            Nothing was changed.
        SetupError: The project cannot be written.
    """
    found = find_project(project)
    folders = {find_backup(found.root, name): path for name, path in _UNDOABLE.items()}
    kept = next((folder for folder in folders if folder), None)
    if kept is None or found.engine_kind is EngineKind.GODOT3:
        raise ConfigError(
            f"{found.root} has no backup of another add-on that can be put back",
            hint=f"--undo takes Godot 4 projects with a folder {' or '.join(_UNDOABLE)}",
        )
    if not force:
        refuse_changed(found.root, kept)
    remove_folder(found.root, folders[kept], force=force)
    return restore(found.root, kept)


def _install_for_gdrl(root: Path, scripts: dict[Path, str], *, force: bool) -> LegacyChange:
    legacy = install_folder(root, GDRL_PATH, force=force)
    addon = install_addon(root, force=force)
    scripts = {file: text for file, text in scripts.items() if not is_forwarding(file)}
    kept = back_up(root, scripts, _GDRL_BACKUP) if scripts else ""
    names = tuple(file.relative_to(root).as_posix() for file in scripts)
    return LegacyChange(addon, legacy, GDRL_PATH, names, kept)


def _forwarding_scripts(root: Path, kind: EngineKind, original: _Original) -> dict[Path, str]:
    """Return what takes the places of an add-on's scripts.

    Raises:
        ConfigError: The game has a class of one of our names, which is not the add-on's.
    """
    ours = own_classes(kind)
    theirs = {name: file for name, file in declared_classes(root) if name in ours}
    root_file = theirs.get(original.root_class)
    script = original.root_script
    if theirs and (root_file is None or (script and root_file.name != script)):
        rows = "\n".join(f"  {name}: {file.relative_to(root)}" for name, file in theirs.items())
        where = f" in a {script}" if script else ""
        raise ConfigError(
            f"the game has classes of these names, which the add-on brings, too:\n{rows}",
            hint=f"rename them; they are not taken for those of {original.name}, as there is no "
            f"{original.root_class}{where}",
        )
    # The root class comes last: until then a repetition knows whose the others are.
    names = sorted(theirs, key=lambda name: name == original.root_class)
    return {theirs[name]: _forwarding_script(original.name, ours[name]) for name in names}


def _require_legacy_game(root: Path, kind: EngineKind) -> None:
    """Raise unless a script or scene names something that a legacy bridge brings."""
    names = {*own_classes(kind), *(["GymGodot"] if kind is EngineKind.GODOT3 else [])}
    if not names_class(root, names):
        other = "GymGodot" if kind is EngineKind.GODOT3 else "Godot RL Agents"
        bridges = f"{_ORIGINALS[kind].name} or {other}"
        raise ConfigError(
            f"{root} was not written for {bridges}: no script or scene names a class of it, so "
            "nothing was installed",
            hint="leave out --legacy: ludus addon install installs the add-on itself",
        )


def _forwarding_script(name: str, path: str) -> str:
    return _FORWARDING_SCRIPT.replace("{name}", name).replace("{path}", path)


def _list_own_classes(root: Path) -> None:
    """Let ``project.godot`` list our scripts under the names that both add-ons have."""
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
