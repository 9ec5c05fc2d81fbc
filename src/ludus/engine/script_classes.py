"""The list of named scripts that Godot 3 keeps in ``project.godot``.

Godot's editor writes the list when it opens a project. In a project that was never opened, or
that got an add-on since, Ludus must write it, or ``class_name`` has no effect.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from ludus.engine.config_file import parse_config, quote_string

__all__ = [
    "ScriptClass",
    "add_script_classes",
    "drop_missing_classes",
    "find_script_classes",
    "move_script_classes",
]

_CLASSES_KEY = "_global_script_classes"
_ICONS_KEY = "_global_script_class_icons"
_CLASS_NAME = re.compile(r'^class_name (\w+)(?:, "([^"]+)")?$', re.MULTILINE)
_EXTENDS = re.compile(r"^extends (\w+)$", re.MULTILINE)
_ITEM = re.compile(r"\{[^{}]*\}")
_LISTED_PATH = re.compile(r'"path":\s*"([^"]+)"')
_LISTED = re.compile(r'"class":\s*"(\w+)"')


@dataclass(frozen=True)
class ScriptClass:
    """A script with a ``class_name``.

    Attributes:
        name: Its name.
        base: The class that it extends.
        path: Its ``res://`` path.
        icon: ``res://`` path of its icon, or an empty text.
    """

    name: str
    base: str
    path: str
    icon: str

    def entry(self) -> str:
        """Return the dictionary that the project file holds."""
        rows = {"base": self.base, "class": self.name, "language": "GDScript", "path": self.path}
        lines = ",\n".join(f'"{key}": {quote_string(value)}' for key, value in rows.items())
        return f"{{\n{lines}\n}}"


def find_script_classes(folder: Path, root: str) -> list[ScriptClass]:
    """List the named scripts of a folder, by name.

    Args:
        folder: Folder of the scripts.
        root: ``res://`` path of that folder.
    """
    found: list[ScriptClass] = []
    for file in sorted(path for path in folder.rglob("*.gd") if not path.is_symlink()):
        text = file.read_text(encoding="utf-8")
        name, base = _CLASS_NAME.search(text), _EXTENDS.search(text)
        if name is not None and base is not None:
            path = f"{root}/{file.relative_to(folder).as_posix()}"
            found.append(ScriptClass(name[1], base[1], path, name[2] or ""))
    return sorted(found, key=lambda script: script.name)


def add_script_classes(text: str, scripts: list[ScriptClass]) -> str:
    """Return the text of a Godot 3 project file with ``scripts`` added to its list.

    The text is returned unchanged if all are listed. Existing entries with the same names stay.
    """
    text = _add_empty_lists(text)
    entries = parse_config(text).entries
    listed = set(_LISTED.findall(entries[f"/{_CLASSES_KEY}"].value))
    new = [script for script in scripts if script.name not in listed]
    icons = [f'"{script.name}": {quote_string(script.icon)}' for script in new]
    text = _append_items(text, _CLASSES_KEY, ", ".join(script.entry() for script in new), ", ")
    return _append_items(text, _ICONS_KEY, ",\n".join(icons), ",\n")


def move_script_classes(text: str, scripts: list[ScriptClass]) -> str:
    """Return the text with the listed scripts replaced by those of ``scripts`` with their names.

    Icons do not change, and scripts that are not listed are not added.
    """
    entry = parse_config(text).entries.get(f"/{_CLASSES_KEY}")
    if entry is None:
        return text
    value = entry.value
    for script in scripts:
        listed = re.compile(rf'\{{[^{{}}]*"class":\s*"{script.name}"[^{{}}]*\}}')
        value = listed.sub(script.entry().replace("\\", r"\\"), value)
    return text[: entry.start] + value + text[entry.end :]


def drop_missing_classes(text: str, root: Path, prefix: str) -> str:
    """Return the text without the listed scripts under ``prefix`` that do not exist.

    Args:
        text: Text of the project file.
        root: Folder of the project.
        prefix: ``res://`` path of a folder.
    """
    entry = parse_config(text).entries.get(f"/{_CLASSES_KEY}")
    if entry is None:
        return text
    value, missing = entry.value, list[str]()
    for listed in _ITEM.findall(entry.value):
        name, path = _LISTED.search(listed), _LISTED_PATH.search(listed)
        if name is None or path is None or not path[1].startswith(f"{prefix}/"):
            continue
        if not (root / path[1].removeprefix("res://")).is_file():
            missing.append(name[1])
            value = re.sub(rf"{re.escape(listed)}(?:,\s*)?", "", value)
    if not missing:
        return text
    text = text[: entry.start] + re.sub(r",\s*\]$", " ]", value) + text[entry.end :]
    icons = parse_config(text).entries.get(f"/{_ICONS_KEY}")
    if icons is None:
        return text
    named = rf'"(?:{"|".join(missing)})":\s*"[^"]*",?\s*'
    value = re.sub(r",\s*\}$", "\n}", re.sub(named, "", icons.value))
    return text[: icons.start] + value + text[icons.end :]


def _add_empty_lists(text: str) -> str:
    """Add the two entries after ``config_version`` if they are missing."""
    for key, empty in ((_ICONS_KEY, "{\n}"), (_CLASSES_KEY, "[  ]")):
        entries = parse_config(text).entries
        if f"/{key}" not in entries:
            end = entries["/config_version"].end
            text = f"{text[:end]}\n{key}={empty}{text[end:]}"
    return text


def _append_items(text: str, key: str, addition: str, separator: str) -> str:
    """Insert items before the closing bracket of a value."""
    if not addition:
        return text
    entry = parse_config(text).entries[f"/{key}"]
    opening, closing = entry.value[0], entry.value[-1]
    inside = entry.value[1:-1].strip()
    lead = f"{inside}{separator}" if inside else ""
    space = " " if closing == "]" else "\n"
    value = f"{opening}{space}{lead}{addition}{space}{closing}"
    return text[: entry.start] + value + text[entry.end :]
