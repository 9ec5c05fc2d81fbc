"""The kinds of target: a closed set of frozen dataclasses, to be told apart with ``match``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import overload

from ludus.engine.bevy_build import PREFIX, build_bevy_example, build_package
from ludus.engine.bundled import find_example, runnable_bundled_root
from ludus.engine.find import InstalledEngine, find_engine
from ludus.engine.project import Project, find_project, scene_path

__all__ = [
    "Address",
    "CargoPackage",
    "EngineTarget",
    "Example",
    "Executable",
    "Game",
    "Gymnasium",
    "Legacy",
    "Play",
    "PolicyFile",
    "Run",
    "Scene",
    "Target",
    "prepare",
]

DEFAULT_PORT = 11011


@dataclass(frozen=True)
class Example:
    """A game that comes with Ludus; :func:`prepare` copies or builds it.

    Attributes:
        name: As typed: ``cartpole``, ``godot3:cartpole`` or ``bevy:cartpole+view``.
        scene: Scene to run instead of the example's own.
        godot: Engine that the user insists on.
    """

    name: str
    scene: str | Path | None = None
    godot: Path | None = None


@dataclass(frozen=True)
class Scene:
    """A scene of a Godot project on disk.

    Attributes:
        project: The project.
        path: ``res://`` path of the scene.
        godot: Engine that the user insists on.
    """

    project: Project
    path: str
    godot: Path | None = None

    @property
    def name(self) -> str:
        """The scene's file name without its ending."""
        return Path(self.path).stem

    def find_engine(self) -> InstalledEngine:
        """Find the engine to run it with.

        Raises:
            ConfigError: The engine that the user named cannot be used.
            EngineNotFound: There is none on this machine.
        """
        return find_engine(self.project.engine_kind, self.godot)


@dataclass(frozen=True)
class Executable:
    """An exported game, or a Bevy game.

    Attributes:
        path: The program, absolute.
    """

    path: Path

    @property
    def name(self) -> str:
        """The program's file name without its ending."""
        return self.path.stem


@dataclass(frozen=True)
class CargoPackage:
    """A Bevy game as source code; :func:`prepare` builds it.

    Attributes:
        path: The folder of its ``Cargo.toml``.
    """

    path: Path

    @property
    def name(self) -> str:
        """The folder's name."""
        return self.path.resolve().name


@dataclass(frozen=True)
class Address:
    """A game that listens somewhere already.

    Attributes:
        host: Name or address of the machine.
        port: TCP port, 1 to 65535.
    """

    host: str
    port: int

    @property
    def name(self) -> str:
        """Host and port, as typed."""
        return f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"


@dataclass(frozen=True)
class Play:
    """A game that the user starts in the editor, and that then connects to us.

    Attributes:
        host: Where we listen.
        port: TCP port.
    """

    host: str = "127.0.0.1"
    port: int = DEFAULT_PORT
    name: str = "play"


@dataclass(frozen=True)
class Gymnasium:
    """An environment of Gymnasium, stepped in this process.

    Attributes:
        env_id: What ``gymnasium.make`` takes: ``ID``, or ``MODULE:ID``.
    """

    env_id: str

    @property
    def name(self) -> str:
        """The target as typed."""
        return f"gym:{self.env_id}"


@dataclass(frozen=True)
class Legacy:
    """A game of a legacy bridge; :mod:`ludus.legacy.registry` knows how to open it.

    Attributes:
        name: As typed, such as ``gymgodot:PATH``.
    """

    name: str


@dataclass(frozen=True)
class Run:
    """What ``ludus train`` left: a run folder, or one checkpoint inside it.

    Attributes:
        path: What was named.
        folder: The run folder.
    """

    path: Path
    folder: Path

    @property
    def name(self) -> str:
        """The path that was named."""
        return str(self.path)


@dataclass(frozen=True)
class PolicyFile:
    """An exported policy (protocol/POLICY.md).

    Attributes:
        path: The file.
    """

    path: Path

    @property
    def name(self) -> str:
        """The file."""
        return str(self.path)


Game = Scene | Executable | Address | Play
"""What a session can be opened with directly."""
EngineTarget = Example | CargoPackage | Game
"""What :func:`prepare` makes a game of, and a pool opens with engines."""
PreparedTarget = Game | Gymnasium | Legacy | Run | PolicyFile
Target = Example | CargoPackage | PreparedTarget


@overload
def prepare(target: EngineTarget) -> Game: ...
@overload
def prepare(target: Target) -> PreparedTarget: ...
def prepare(target: Target) -> PreparedTarget:
    """Return what is to be started: examples are copied or built, Cargo packages built.

    Others stay as they are.

    Raises:
        SetupError: An example or package cannot be prepared.
        TargetError: The example has no such scene, or the package not one program.
    """
    if isinstance(target, CargoPackage):
        return Executable(build_package(target.path))
    if not isinstance(target, Example):
        return target
    found = find_example(target.name)
    if found is None:
        return Executable(build_bevy_example(target.name.removeprefix(PREFIX)))
    kind, folder = found
    project = find_project(runnable_bundled_root(kind))
    scene = target.scene or f"res://examples/{folder}/{folder}.tscn"
    return Scene(project, scene_path(project, scene), target.godot)
