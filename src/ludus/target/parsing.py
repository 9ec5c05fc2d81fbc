"""From the words that a user typed to a kind of target. Nothing is built, copied or started."""

from __future__ import annotations

import difflib
import os
import re
import sys
from pathlib import Path

from ludus.engine.bevy_build import MANIFEST, bevy_example_names, find_bevy_example
from ludus.engine.bundled import example_names, find_example
from ludus.engine.project import PROJECT_FILE, SCENE_SUFFIXES, find_project, scene_path
from ludus.errors import TargetError
from ludus.target.kinds import (
    Address,
    CargoPackage,
    Example,
    Executable,
    Gymnasium,
    Legacy,
    Play,
    PolicyFile,
    Run,
    Scene,
    Target,
)

__all__ = ["GYMNASIUM_PREFIX", "LEGACY_PREFIXES", "find_run", "parse_target", "split_addresses"]

GYMNASIUM_PREFIX = "gym:"
LEGACY_PREFIXES = ("godot_gym_api:", "gdrl:", "gymgodot:", "http://")
PLAY = "play"
POLICY_FILE_SUFFIX = ".ludus.json"

_ADDRESS = re.compile(r"^(?:\[(?P<v6>[0-9a-fA-F:.]+)\]|(?P<host>[\w.-]+)):(?P<port>\d{1,5})$")


def parse_target(
    target: str | Path, *, scene: str | Path | None = None, godot: Path | str | None = None
) -> Target:
    """Return what the user means.

    Args:
        target: One of the words of docs/targets.md. A bare word is an example: ``./cartpole`` is
            a folder of that name.
        scene: Scene to run instead of the main scene; for projects and Godot examples only.
        godot: Engine executable to use instead of looking for one.

    Raises:
        TargetError: There is no such thing, or it cannot be run.
    """
    text, path = str(target), Path(target).expanduser()
    if not text:
        raise TargetError("no target was given", "name one: ludus train cartpole")
    engine = None if godot is None else Path(godot)
    parsed = _parse_word(text)
    if parsed is None and find_example(text) is not None:
        return Example(text, scene, engine)
    if parsed is None and path.exists():
        if (path / MANIFEST).is_file() and not (path / PROJECT_FILE).is_file():
            parsed = CargoPackage(path)
        elif _has_scenes(path):
            return _parse_project(path, scene, engine)
        parsed = parsed or find_run(path) or _parse_file(path)
    parsed = parsed or _parse_address(text)
    if parsed is None and split_addresses(text):
        raise TargetError(
            f"{text} names several games, and each needs a worker of its own",
            "ludus train with --cluster local:N plays N running games",
        )
    if parsed is None:
        raise _unknown(text)
    if not isinstance(parsed, Legacy):  # whose bridge refuses more settings than this one
        _refuse_scene(scene, text)
    return parsed


def find_run(path: Path) -> Run | None:
    """Return the run that a path names: its folder, or one of its checkpoints; None if none."""
    if not path.is_dir() or (path / PROJECT_FILE).is_file():
        return None
    # Resolved only where it must be, so that messages show the path as it was given.
    folders = (path, path.parent.parent, path.resolve().parent.parent)
    found = next((folder for folder in folders if (folder / "config.json").is_file()), None)
    return None if found is None else Run(path, found)


def _parse_word(text: str) -> Target | None:
    if text == PLAY:
        return Play()
    if text.startswith(GYMNASIUM_PREFIX):
        return Gymnasium(text.removeprefix(GYMNASIUM_PREFIX))
    if text.startswith(LEGACY_PREFIXES):
        return Legacy(text)
    return None if find_bevy_example(text) is None else Example(text)


def _has_scenes(path: Path) -> bool:
    """Tell a project, its ``project.godot`` or a scene from a run, a policy file or a program."""
    if path.is_dir():
        return path.suffix != ".app" and find_run(path) is None
    return path.name == PROJECT_FILE or path.suffix in SCENE_SUFFIXES


def _parse_project(path: Path, scene: str | Path | None, godot: Path | None) -> Scene:
    if path.is_dir() or path.name == PROJECT_FILE:
        folder = path if path.is_dir() else path.parent
    else:
        _refuse_scene(scene, str(path))
        folder, scene = path.parent, path.absolute()
    project = find_project(folder)
    return Scene(project, scene_path(project, scene), godot)


def _refuse_scene(scene: str | Path | None, target: str) -> None:
    if scene is not None:
        raise TargetError(
            f"the scene {scene} was named, but {target} decides itself what it runs",
            hint="leave the scene out, or name the project folder as target",
        )


def _parse_file(path: Path) -> PolicyFile | Executable:
    if path.name.endswith(POLICY_FILE_SUFFIX):
        return PolicyFile(path)
    program = _program_of(path)
    if program is None:
        raise TargetError(
            f"{path} is neither a scene (.tscn) nor an executable",
            hint="name a project folder, a scene, or a game exported for this machine",
        )
    return Executable(program.absolute())


def _program_of(path: Path) -> Path | None:
    """Return the program to start, which a macOS ``.app`` hides inside."""
    if path.suffix == ".app" and path.is_dir():
        inside = sorted((path / "Contents" / "MacOS").glob("*"))
        return inside[0] if inside else None
    if sys.platform == "win32":
        return path if path.suffix.lower() == ".exe" else None
    return path if os.access(path, os.X_OK) else None


def _parse_address(text: str) -> Address | None:
    match = _ADDRESS.match(text)
    if match is None:
        return None
    port = int(match["port"])
    if not 1 <= port <= 65535:
        raise TargetError(f"{text}: port {port} is not between 1 and 65535")
    return Address(match["v6"] or match["host"], port)


def split_addresses(target: str) -> list[str]:
    """Return the parts of ``HOST:PORT,HOST:PORT``; of any other target, nothing."""
    parts = target.split(",")
    return parts if all(_ADDRESS.match(part) for part in parts) else []


def _unknown(text: str) -> TargetError:
    names = [*example_names(), *bevy_example_names()]
    close = difflib.get_close_matches(text, [*names, PLAY], n=3)
    message = f"there is no example, file or folder called {text!r}"
    if close:
        message += "; close: " + ", ".join(close)
    return TargetError(
        message,
        hint=f"bundled examples: {', '.join(names) or '(none)'}; or a project folder, a .tscn, "
        f"an exported game, host:port, {PLAY}, or gym:ENV_ID; `ludus runs` lists runs",
    )
