"""Find GymGodot in a project: its script, and scenes in which our node has to be told more."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from ludus.addon import ADDON_PATH, LEGACY_PATH
from ludus.legacy.addon_files import is_hidden

__all__ = ["SCRIPT", "gymgodot_scripts", "scenes_without_action"]

SCRIPT = f"{LEGACY_PATH}/gym_godot.gd"
"""Our script in the place of GymGodot's."""

_SCRIPT_NAME = "GymGodot.gd"
_SIGNS = ("stepLength", "environmentNode", "WebSocketClient")
"""Words by which GymGodot's script is known."""
_REFERENCE = re.compile(
    r'^\[ext_resource path="[^"]*/(?:GymGodot\.(?:tscn|gd)|gym_godot\.gd)".* id=(\d+)\]$',
    re.MULTILINE,
)
_SECTION = re.compile(r"^\[node [^\n]*\]$.*?(?=^\[|\Z)", re.MULTILINE | re.DOTALL)
_ACTION = re.compile(r"^(?:discrete_n|continuous_size|action) = ", re.MULTILINE)


def gymgodot_scripts(root: Path) -> Iterator[Path]:
    """Yield GymGodot's own script, wherever the project has it."""
    for file in sorted(root.rglob(_SCRIPT_NAME)):
        text = file.read_text(encoding="utf-8", errors="replace")
        if not is_hidden(file, root) and all(sign in text for sign in _SIGNS):
            yield file


def scenes_without_action(root: Path) -> tuple[str, ...]:
    """List scenes with a node of GymGodot that does not say what an action is."""
    found = (file.relative_to(root).as_posix() for file in _without_action(root))
    return tuple(sorted(found))


def _without_action(root: Path) -> Iterator[Path]:
    """Yield scenes with a node of GymGodot that does not say what an action is."""
    ours = {root / ADDON_PATH, root / LEGACY_PATH}
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
