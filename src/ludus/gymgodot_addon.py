"""Let a project that was written for GymGodot run on our protocol.

GymGodot's script is put aside. Where it stood, a script of one line stands for ours, so that the
scenes that name its path, above all ``GymGodot.tscn``, find it. Nothing else in the game changes.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from ludus.addon import ADDON_PATH, CLASSIC_PATH, install_addon, install_folder
from ludus.classic_files import (
    ClassicChange,
    declared_classes,
    is_hidden,
    own_classes,
    put_aside,
)
from ludus.engine.kinds import EngineKind
from ludus.errors import ConfigError

__all__ = ["KEPT_PATH", "install_for_gymgodot"]

KEPT_PATH = "gymgodot.old"
"""Where replaced files are kept; Godot does not look into it."""

_SCRIPT_NAME = "GymGodot.gd"
_SIGNS = ("stepLength", "environmentNode", "WebSocketClient")
"""Words by which GymGodot's script is known."""
_STAND_IN = f"""\
extends "res://{CLASSIC_PATH}/gym_godot.gd"
# Stands where the script of GymGodot stood, for scenes that name its path.
# Made by `ludus addon install --classic`, which keeps that script in {{kept}}.
"""
_REFERENCE = re.compile(
    r'^\[ext_resource path="[^"]*/(?:GymGodot\.(?:tscn|gd)|gym_godot\.gd)".* id=(\d+)\]$',
    re.MULTILINE,
)
_SECTION = re.compile(r"^\[node [^\n]*\]$.*?(?=^\[|\Z)", re.MULTILINE | re.DOTALL)
_ACTION = re.compile(r"^(?:discrete_n|continuous_size|action) = ", re.MULTILINE)


def install_for_gymgodot(root: Path, *, force: bool) -> ClassicChange:
    """Install the add-on, with a node in the place of GymGodot's. Repeating it changes nothing.

    Args:
        root: Folder of a Godot 3 project.
        force: Overwrite files of the add-on that were changed by hand.

    Raises:
        ConfigError: Files of the add-on were changed by hand, or a class of the game has a name
            that the add-on needs.
        SetupError: The project cannot be written.
    """
    _refuse_foreign_classes(root)
    classic = install_folder(root, CLASSIC_PATH, force=force)
    addon = install_addon(root, force=force)
    scripts = list(_scripts(root))
    kept = put_aside(root, dict.fromkeys(scripts, _STAND_IN), KEPT_PATH) if scripts else ""
    return ClassicChange(
        addon, classic, _relative(root, scripts), kept, _relative(root, _without_action(root))
    )


def _scripts(root: Path) -> Iterator[Path]:
    """Yield GymGodot's own script, wherever the project has it."""
    for file in sorted(root.rglob(_SCRIPT_NAME)):
        text = file.read_text(encoding="utf-8", errors="replace")
        if not is_hidden(file, root) and all(sign in text for sign in _SIGNS):
            yield file


def _without_action(root: Path) -> Iterator[Path]:
    """Yield scenes with a node of GymGodot that does not say what an action is."""
    ours = {root / ADDON_PATH, root / CLASSIC_PATH}
    for file in sorted(root.rglob("*.tscn")):
        if is_hidden(file, root) or file.name == "GymGodot.tscn" or ours & set(file.parents):
            continue
        text = file.read_text(encoding="utf-8", errors="replace")
        ids = "|".join(_REFERENCE.findall(text))
        used = re.compile(rf"(?:instance|script) ?= ?ExtResource\( ?(?:{ids}) ?\)")
        if ids and any(
            used.search(section) and not _ACTION.search(section)
            for section in _SECTION.findall(text)
        ):
            yield file


def _refuse_foreign_classes(root: Path) -> None:
    ours = own_classes(EngineKind.GODOT3)
    theirs = {name: file for name, file in declared_classes(root) if name in ours}
    if theirs:
        rows = "\n".join(f"  {name}: {file.relative_to(root)}" for name, file in theirs.items())
        raise ConfigError(
            f"the game has classes of these names, which the add-on brings, too:\n{rows}",
            hint="if they are those of godot_gym_api, remove its folder; else rename them",
        )


def _relative(root: Path, files: Iterator[Path] | list[Path]) -> tuple[str, ...]:
    return tuple(sorted(file.relative_to(root).as_posix() for file in files))
