"""What the user asks to run: an example, a project, a scene, an exported game or an address."""

from __future__ import annotations

import difflib
import os
import re
import sys
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from ludus.engine.bevy_build import bevy_example_names, build_bevy_example, find_bevy_example
from ludus.engine.bundled import example_names, find_example, runnable_bundled_root
from ludus.engine.find import InstalledEngine, find_engine
from ludus.engine.kinds import EngineKind
from ludus.engine.project import PROJECT_FILE, SCENE_SUFFIXES, Project, find_project, scene_path
from ludus.errors import TargetError

__all__ = ["BRIDGE_PREFIXES", "DEFAULT_PORT", "PLAY", "Target", "TargetKind", "resolve_target"]

DEFAULT_PORT = 11011
PLAY = "play"
BRIDGE_PREFIXES = ("godot_gym_api:", "gymgodot:", "http://")
"""How targets begin that are games of legacy bridges, which `ludus.legacy` opens."""

_ADDRESS = re.compile(r"^(?:\[(?P<v6>[0-9a-fA-F:.]+)\]|(?P<host>[\w.-]+)):(?P<port>\d{1,5})$")


class TargetKind(StrEnum):
    """Ways to reach a game."""

    EXAMPLE = "example"
    PROJECT = "project"
    EXECUTABLE = "executable"
    ADDRESS = "address"
    PLAY = "play"


@dataclass(frozen=True, kw_only=True)
class Target:
    """A game to run or to wait for.

    Attributes:
        kind: How it is reached.
        name: What the user called it, for messages and folder names.
        project: Its project (examples and projects).
        scene: ``res://`` path of the scene to run (examples and projects).
        executable: The exported game (executables).
        address: Where the game listens (addresses), or where to listen for it (play).
        godot: Engine the user insists on.
    """

    kind: TargetKind
    name: str
    project: Project | None = None
    scene: str | None = None
    executable: Path | None = None
    address: tuple[str, int] | None = None
    godot: Path | None = None

    @property
    def engine_kind(self) -> EngineKind | None:
        """The engine that must be installed to run it; None if it needs none."""
        return None if self.project is None else self.project.engine_kind

    @property
    def is_started_by_us(self) -> bool:
        """Whether Ludus starts the game, rather than the user."""
        return self.kind not in {TargetKind.ADDRESS, TargetKind.PLAY}

    def find_engine(self) -> InstalledEngine | None:
        """Find the engine to run it with; None if it needs none.

        Raises:
            ConfigError: The engine that the user named cannot be used.
            EngineNotFound: There is none on this machine.
        """
        kind = self.engine_kind
        return None if kind is None else find_engine(kind, self.godot)


def resolve_target(
    target: str | Path, *, scene: str | Path | None = None, godot: Path | str | None = None
) -> Target:
    """Work out what the user means.

    Args:
        target: One of: the name of a bundled example (``godot3:cartpole`` is the one for
            Godot 3, ``bevy:cartpole`` the one for Bevy, which is built); ``play``, to wait for
            a game that the user starts in the editor; ``host:port`` of a game that listens there;
            the folder of a Godot project; a ``.tscn``; an exported game or a Bevy executable. A
            bare word is an example: write ``./cartpole`` for a folder of that name.
        scene: Scene to run instead of the main scene; for projects and examples only.
        godot: Engine executable to use instead of looking for one.

    Raises:
        TargetError: There is no such thing, or it cannot be run.
        SetupError: A bundled example was asked for and cannot be prepared.
    """
    engine = None if godot is None else Path(godot)
    text = str(target)
    if text.startswith(BRIDGE_PREFIXES):
        raise _only_in_python(text)
    if text == PLAY:
        _refuse_scene(scene, text)
        return Target(kind=TargetKind.PLAY, name=PLAY, address=("127.0.0.1", DEFAULT_PORT))
    example = find_example(text)
    if example is not None:
        return _example(*example, scene, engine)
    bevy_example = find_bevy_example(text)
    if bevy_example is not None:
        _refuse_scene(scene, text)
        return Target(
            kind=TargetKind.EXECUTABLE,
            name=bevy_example,
            executable=build_bevy_example(bevy_example),
        )
    path = Path(target).expanduser()
    if path.exists():
        return _on_disk(path, scene, engine)
    address = _parse_address(text)
    if address is not None:
        _refuse_scene(scene, text)
        return Target(kind=TargetKind.ADDRESS, name=text, address=address)
    raise _unknown(text)


def _example(kind: EngineKind, name: str, scene: str | Path | None, godot: Path | None) -> Target:
    project = find_project(runnable_bundled_root(kind))
    return Target(
        kind=TargetKind.EXAMPLE,
        name=name,
        project=project,
        scene=scene_path(project, scene or f"res://examples/{name}/{name}.tscn"),
        godot=godot,
    )


def _on_disk(path: Path, scene: str | Path | None, godot: Path | None) -> Target:
    if path.is_dir() and path.suffix != ".app":
        return _project(path, scene, godot)
    if path.name == PROJECT_FILE:
        return _project(path.parent, scene, godot)
    if path.suffix in SCENE_SUFFIXES:
        _refuse_scene(scene, str(path))
        return _project(path.parent, path.absolute(), godot)
    return _executable(path, scene)


def _project(folder: Path, scene: str | Path | None, godot: Path | None) -> Target:
    project = find_project(folder)
    found = scene_path(project, scene)
    name = Path(found).stem
    return Target(kind=TargetKind.PROJECT, name=name, project=project, scene=found, godot=godot)


def _executable(path: Path, scene: str | Path | None) -> Target:
    program = _program_of(path)
    if program is None:
        raise TargetError(
            f"{path} is neither a scene (.tscn) nor an executable",
            hint="name a project folder, a scene, or a game exported for this machine",
        )
    _refuse_scene(scene, str(path))
    return Target(kind=TargetKind.EXECUTABLE, name=path.stem, executable=program.absolute())


def _program_of(path: Path) -> Path | None:
    """Return the program to start, which a macOS ``.app`` hides inside."""
    if path.suffix == ".app" and path.is_dir():
        inside = sorted((path / "Contents" / "MacOS").glob("*"))
        return inside[0] if inside else None
    if sys.platform == "win32":
        return path if path.suffix.lower() == ".exe" else None
    return path if os.access(path, os.X_OK) else None


def _parse_address(text: str) -> tuple[str, int] | None:
    match = _ADDRESS.match(text)
    if match is None:
        return None
    port = int(match["port"])
    if not 1 <= port <= 65535:
        raise TargetError(f"{text}: port {port} is not between 1 and 65535")
    return match["v6"] or match["host"], port


def _refuse_scene(scene: str | Path | None, target: str) -> None:
    if scene is not None:
        raise TargetError(
            f"the scene {scene} was named, but {target} decides itself what it runs",
            hint="leave the scene out, or name the project folder as target",
        )


def _only_in_python(text: str) -> TargetError:
    return TargetError(
        f"{text} is a game of a legacy bridge, which does not tell what a command needs to know",
        hint=f"in Python: ludus.make({text!r}, action_space=…, observation_space=…, …); for a "
        "command give the game an id: gym:MODULE:ID (docs/gymgodot.md, docs/godot_gym_api.md)",
    )


def _unknown(text: str) -> TargetError:
    names = [*example_names(), *bevy_example_names()]
    close = difflib.get_close_matches(text, [*names, PLAY], n=3)
    message = f"there is no example, file or folder called {text!r}"
    if close:
        message += "; close: " + ", ".join(close)
    return TargetError(
        message,
        hint=f"bundled examples: {', '.join(names) or '(none)'}; or a project folder, a .tscn, "
        f"an exported game, host:port, or {PLAY}",
    )
