"""The scripts that a scene names, and what they say without comments and strings.

Nothing runs: files are read as text, and what a name means is not resolved.
"""

from __future__ import annotations

import posixpath
import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from ludus.engine.config_file import parse_config
from ludus.engine.project import PROJECT_FILE

__all__ = ["Function", "Script", "find_scripts", "functions_of_reset"]

ADDON_FOLDER = "addons/ludus/"
_PREFIX = "res://"
_AUTOLOAD = "autoload/"
# Triple quotes come first, or they would be read as an empty string and the start of another.
_NO_CODE = re.compile(
    r"""\"{3}.*?\"{3}|'{3}.*?'{3}|"(?:\\.|[^"\\])*"|'(?:\\.|[^'\\])*'|\#[^\n]*""", re.DOTALL
)
_VISIBLE = re.compile(r"\S")
_FUNCTION = re.compile(
    r"^([ \t]*)(?:\S[^\n]*?[ \t])?func[ \t]+(\w+)[ \t]*\([^)]*\)[^\n]*\n"
    r"(?:[ \t]*\n|\1[ \t]+[^\n]*\n)*",
    re.MULTILINE,
)
_CLASS_NAME = re.compile(r"^[^#\n]*\bclass_name[ \t]+(\w+)", re.MULTILINE)
_LOADED = re.compile(r"""\b(?:preload|load|extends)\b[\s(]*["']([^"'\n]+)["']""")
_RESOURCE = re.compile(r'^\[ext_resource [^\]\n]*?\bpath="([^"]+)"', re.MULTILINE)
_CALL = re.compile(r"\b(\w+)\s*\(")
_WORD = re.compile(r"\w+")


@dataclass(frozen=True)
class Function:
    """A function of a script.

    Attributes:
        name: Its name.
        start: Offset of its first line in the script's code.
        code: Its signature and body.
    """

    name: str
    start: int
    code: str


@dataclass(frozen=True)
class Script:
    """A GDScript file.

    Attributes:
        path: ``res://`` path.
        text: The file as it is.
    """

    path: str
    text: str

    @cached_property
    def code(self) -> str:
        """The text with spaces in place of comments and strings, so that offsets stay."""
        return _NO_CODE.sub(lambda found: _VISIBLE.sub(" ", found[0]), f"{self.text}\n")

    @cached_property
    def functions(self) -> tuple[Function, ...]:
        """Its functions in order, those of inner classes included; lambdas belong to others."""
        return tuple(
            Function(found[2], found.start(), found[0]) for found in _FUNCTION.finditer(self.code)
        )

    def place(self, offset: int) -> str:
        """Return path and line of an offset in the code: ``res://player.gd:14``."""
        line = self.code.count("\n", 0, offset) + 1
        return f"{self.path}:{line}"


def find_scripts(root: Path, scene: str) -> tuple[Script, ...]:
    """Read the scripts of a scene: of its nodes, of scenes inside it, and what those load or name.

    A script names another by ``preload()``, ``load()``, ``extends``, its ``class_name`` or as an
    autoload. Scripts of Ludus are left out, and so is what the engine alone can read, such as
    binary scenes and paths that are put together while the game runs.

    Args:
        root: Folder of the project.
        scene: ``res://`` path of the scene.
    """
    named = _named_files(root)
    waiting, seen, found = [scene.removeprefix(_PREFIX)], set[str](), list[Script]()
    while waiting:
        path = waiting.pop(0)
        file = root / path
        is_text = file.suffix in {".gd", ".tscn", ".tres"}
        if path in seen or path.startswith(ADDON_FOLDER) or not is_text or not file.is_file():
            continue
        seen.add(path)
        text = file.read_text("utf-8", errors="replace")
        if file.suffix != ".gd":
            waiting += _paths(_RESOURCE.findall(text), path)
            continue
        script = Script(_PREFIX + path, text)
        found.append(script)
        # A match in a comment or in a string has no code where it starts.
        loaded = [m[1] for m in _LOADED.finditer(text) if not script.code[m.start()].isspace()]
        waiting += _paths(loaded, path)
        waiting += [named[word] for word in _WORD.findall(script.code) if word in named]
    return tuple(found)


def functions_of_reset(scripts: Iterable[Script]) -> list[tuple[Script, Function]]:
    """List the functions called ``reset``, and those that they call by name, however indirectly.

    Names alone count: a call of ``start()`` leads to each function of that name.
    """
    functions = [(script, function) for script in scripts for function in script.functions]
    reached, waiting = set[str](), {"reset"}
    while waiting:
        reached |= waiting
        bodies = [function.code for _, function in functions if function.name in waiting]
        waiting = {name for body in bodies for name in _CALL.findall(body)} - reached
    return [(script, function) for script, function in functions if function.name in reached]


def _named_files(root: Path) -> dict[str, str]:
    """Return the files that code can use by name, autoloads and named classes, by that name."""
    named: dict[str, str] = {}
    for file in sorted(root.rglob("*.gd")):
        found = _CLASS_NAME.search(file.read_text("utf-8", errors="replace"))
        if found is not None:
            named[found[1]] = file.relative_to(root).as_posix()
    config = parse_config((root / PROJECT_FILE).read_text("utf-8", errors="replace"))
    for key in config.entries:
        if key.startswith(_AUTOLOAD):
            # The star says that the autoload is a variable of all scripts.
            path = (config.string(key) or "").removeprefix("*").removeprefix(_PREFIX)
            named[key.removeprefix(_AUTOLOAD)] = path
    return named


def _paths(references: Iterable[str], origin: str) -> list[str]:
    """Return the paths inside the project of what a file at ``origin`` refers to."""
    folder = posixpath.dirname(origin)
    return [
        reference.removeprefix(_PREFIX)
        if reference.startswith(_PREFIX)
        else posixpath.normpath(posixpath.join(folder, reference))
        for reference in references
    ]
