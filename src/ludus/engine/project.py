"""A Godot project on disk: where it is, which engine it needs, what it runs."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ludus.engine.config_file import parse_config
from ludus.engine.kinds import EngineKind
from ludus.errors import TargetError

__all__ = [
    "PROJECT_FILE",
    "RUN_SCENE",
    "Project",
    "find_project",
    "read_project",
    "require_addon",
    "scene_path",
]


PROJECT_FILE = "project.godot"
RUN_SCENE = "res://addons/ludus/run.tscn"
"""Scene of the add-on that runs another one."""
SCENE_SUFFIXES = (".tscn", ".scn")
DEFAULT_TICKS_PER_SECOND = 60

_KIND_OF_CONFIG_VERSION = {5: EngineKind.GODOT4, 4: EngineKind.GODOT3}
_TICKS_KEY = {
    EngineKind.GODOT4: "physics/common/physics_ticks_per_second",
    EngineKind.GODOT3: "physics/common/physics_fps",
}
_SCENE_UID = re.compile(r'^\[gd_scene[^\]]*\buid="(uid://[^"]+)"')
_HEADER_CHARACTERS = 512


@dataclass(frozen=True)
class Project:
    """What Ludus needs to know of a project.

    Attributes:
        root: Folder of ``project.godot``, absolute.
        name: Name of the game, or of the folder.
        engine_kind: Engine that it was made for.
        main_scene: ``res://`` or ``uid://`` path of the main scene, if it has one.
        ticks_per_second: Physics ticks per second of game time.
    """

    root: Path
    name: str
    engine_kind: EngineKind
    main_scene: str | None
    ticks_per_second: int


def find_project(path: Path) -> Project:
    """Read the project that a folder, a scene or a ``project.godot`` belongs to.

    Raises:
        TargetError: There is no project there, or it cannot be used.
    """
    start = path.expanduser().absolute()
    for folder in (start, *start.parents):
        if (folder / PROJECT_FILE).is_file():
            return read_project(folder)
    raise TargetError(
        f"there is no {PROJECT_FILE} in {start} or in any folder above",
        hint="name the folder of a Godot project, or a scene inside one",
    )


def read_project(root: Path) -> Project:
    """Read ``root/project.godot``.

    Raises:
        TargetError: It cannot be read, or was made for an engine that Ludus does not support.
    """
    file = root / PROJECT_FILE
    try:
        config = parse_config(file.read_text(encoding="utf-8-sig"))
    except (OSError, UnicodeDecodeError) as error:
        raise TargetError(f"{file} cannot be read: {error}") from error
    version = config.integer("/config_version")
    kind = _KIND_OF_CONFIG_VERSION.get(version or 0)
    if kind is None:
        raise TargetError(
            f"{file} has config_version {version}; expected 5 (Godot 4) or 4 (Godot 3)",
            hint="open and save the project in Godot 4 once",
        )
    return Project(
        root=root.resolve(),
        name=config.string("application/config/name") or root.resolve().name,
        engine_kind=kind,
        main_scene=config.string("application/run/main_scene") or None,
        ticks_per_second=config.integer(_TICKS_KEY[kind]) or DEFAULT_TICKS_PER_SECOND,
    )


def require_addon(project: Project) -> None:
    """Check that the project has the Ludus add-on.

    Raises:
        TargetError: It does not.
    """
    if not (project.root / RUN_SCENE.removeprefix("res://")).is_file():
        hint = f"run `ludus addon install {project.root}`"
        raise TargetError(f"{project.root} has no Ludus add-on", hint)


def scene_path(project: Project, scene: str | Path | None) -> str:
    """Turn the user's name for a scene into ``res://…``.

    Args:
        project: The project that must contain it.
        scene: A ``res://`` or ``uid://`` path, a path on disk (relative to the current folder
            or to the project), or None for the main scene.

    Raises:
        TargetError: The scene is missing or outside the project, or the project has no main
            scene.
    """
    if scene is None:
        if project.main_scene is None:
            raise TargetError(
                f"the project {project.root} has no main scene, and no scene was named",
                hint=_scene_hint(project),
            )
        scene = project.main_scene
    text = str(scene)
    if text.startswith("uid://"):
        file = _scene_with_uid(project, text)
    elif text.startswith("res://"):
        file = project.root / text.removeprefix("res://")
    else:
        file = Path(scene).expanduser()
        in_project = project.root / file
        file = in_project if in_project.is_file() else file.absolute()
    resolved = file.resolve()
    if not resolved.is_file():
        raise TargetError(f"there is no scene {file}", hint=_scene_hint(project))
    if not resolved.is_relative_to(project.root):
        raise TargetError(
            f"the scene {resolved} is outside the project {project.root}",
            hint="a game can only load files in its project folder",
        )
    if resolved.suffix not in SCENE_SUFFIXES:
        raise TargetError(f"{resolved} is not a scene", hint=_scene_hint(project))
    return "res://" + resolved.relative_to(project.root).as_posix()


def _scene_with_uid(project: Project, uid: str) -> Path:
    for file in _scenes(project):
        with file.open(encoding="utf-8", errors="replace") as opened:
            match = _SCENE_UID.match(opened.read(_HEADER_CHARACTERS))
        if match is not None and match[1] == uid:
            return file
    raise TargetError(f"no scene in {project.root} has {uid}", hint=_scene_hint(project))


def _scene_hint(project: Project) -> str:
    names = [file.relative_to(project.root).as_posix() for file in _scenes(project)]
    shown = ", ".join(sorted(names)[:8])
    return f"scenes of this project: {shown}" if shown else "the project has no scenes"


def _scenes(project: Project) -> Iterator[Path]:
    for file in project.root.rglob("*.tscn"):
        if not any(part.startswith(".") for part in file.relative_to(project.root).parts):
            yield file
