"""Make a new project that trains at once, and give projects script templates."""

from __future__ import annotations

import shutil
from enum import StrEnum
from pathlib import Path

from ludus.addon.install import install_addon
from ludus.engine.bundled import bundled_root
from ludus.engine.kinds import EngineKind
from ludus.engine.project import Project, read_project
from ludus.errors import ConfigError, SetupError

__all__ = ["ProjectKind", "add_script_templates", "make_project"]

SCRIPT_TEMPLATES = "script_templates"
_TEMPLATES = Path(__file__).parent / "templates"


class ProjectKind(StrEnum):
    """What a new project holds: a game in 2D, in 3D, or in one script."""

    TWO_D = "2d"
    THREE_D = "3d"
    SIMULATION = "simulation"


def make_project(folder: Path, kind: ProjectKind) -> Path:
    """Make a Godot 4 project with a small game, the add-on and a README; return its folder.

    Args:
        folder: Where; its name is the project's.
        kind: Which game.

    Raises:
        ConfigError: The folder exists and is not empty, or its name does not fit into a file.
        SetupError: It cannot be written.
    """
    name = folder.resolve().name
    if not name or not name.isprintable() or set(name) & set('"\\{}'):
        raise ConfigError(f"{name!r} is not a valid project name", "use letters, digits, - and _")
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ConfigError(
            f"{folder} exists already", "choose a name that is free, or an empty folder"
        )
    try:
        for source in (_TEMPLATES / "common", _TEMPLATES / kind):
            for file in sorted(source.iterdir()):
                folder.mkdir(parents=True, exist_ok=True)
                text = file.read_text(encoding="utf-8").replace("{{name}}", name)
                (folder / file.name).write_text(text, encoding="utf-8")
    except OSError as error:
        raise SetupError(
            f"{folder} cannot be written: {error}",
            hint="choose a folder that is writable, on a disk that is not full",
        ) from error
    install_addon(folder)
    add_script_templates(read_project(folder))
    return folder


def add_script_templates(project: Project) -> tuple[str, ...]:
    """Copy script templates into a project, where it has none of the same name; Godot 4 only.

    Args:
        project: The project.

    Returns:
        The new files, relative to the project.

    Raises:
        SetupError: The project cannot be written.
    """
    if project.engine_kind is not EngineKind.GODOT4:
        return ()
    root, source = project.root, bundled_root(EngineKind.GODOT4) / SCRIPT_TEMPLATES
    added: list[str] = []
    try:
        for file in sorted(source.rglob("*")):
            target = root / SCRIPT_TEMPLATES / file.relative_to(source)
            if file.is_file() and not target.exists():
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(file, target)
                added.append(target.relative_to(root).as_posix())
    except OSError as error:
        raise SetupError(
            f"script templates could not be written to {root}: {error}",
            hint="the project folder must be writable, and the disk not full",
        ) from error
    return tuple(added)
