"""Make a new project that trains at once, and give projects script templates."""

from __future__ import annotations

import re
import shutil
from enum import StrEnum
from pathlib import Path

from ludus.addon.install import install_addon
from ludus.engine.bundled import bevy_workspace, bundled_root
from ludus.engine.kinds import EngineKind
from ludus.engine.project import Project, read_project
from ludus.errors import ConfigError, SetupError

__all__ = ["ProjectKind", "add_script_templates", "make_project"]

SCRIPT_TEMPLATES = "script_templates"
_TEMPLATES = Path(__file__).parent / "templates"


class ProjectKind(StrEnum):
    """What a new project holds: a game for Godot in 2D, in 3D or in one script, or for Bevy."""

    TWO_D = "2d"
    THREE_D = "3d"
    SIMULATION = "simulation"
    BEVY = "bevy"


def make_project(folder: Path, kind: ProjectKind) -> Path:
    """Make a project with a small game and a README; return its folder.

    A project for Godot 4 has the add-on. A Cargo package for Bevy has the path of the crate
    ``bevy_ludus`` that came with this Ludus.

    Args:
        folder: Where; its name is the project's.
        kind: Which game.

    Raises:
        ConfigError: The folder exists and is not empty, or its name does not fit into a file.
        SetupError: It cannot be written, or this installation has no crates for Bevy.
    """
    name = folder.resolve().name
    _check_name(name, kind)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ConfigError(
            f"{folder} exists already", "choose a name that is free, or an empty folder"
        )
    if kind is ProjectKind.BEVY:
        _write(folder, [kind], {"name": name, "bevy_ludus": _bevy_crate()})
        return folder
    _write(folder, ["common", kind], {"name": name})
    install_addon(folder)
    add_script_templates(read_project(folder))
    return folder


def _check_name(name: str, kind: ProjectKind) -> None:
    if kind is ProjectKind.BEVY:
        is_valid = re.fullmatch(r"[A-Za-z_][A-Za-z0-9_-]*", name) is not None
        hint = "use letters, digits, - and _, as Cargo does for packages, and no digit first"
    else:
        is_valid = name.isprintable() and bool(name) and not set(name) & set('"\\{}')
        hint = "use letters, digits, - and _"
    if not is_valid:
        raise ConfigError(f"{name!r} is not a valid project name", hint)


def _bevy_crate() -> str:
    workspace = bevy_workspace()
    if workspace is None:
        raise SetupError(
            "this installation of Ludus lacks its crates for Bevy",
            hint="install Ludus again: pip install --force-reinstall ludus-rl",
        )
    return (workspace / "crates" / "bevy_ludus").as_posix()


def _write(folder: Path, templates: list[str], values: dict[str, str]) -> None:
    """Write the files of templates, with ``{{word}}`` replaced by its value."""
    try:
        for source in (_TEMPLATES / template for template in templates):
            for file in sorted(path for path in source.rglob("*") if path.is_file()):
                text = file.read_text(encoding="utf-8")
                for word, value in values.items():
                    text = text.replace(f"{{{{{word}}}}}", value)
                target = folder / file.relative_to(source)
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_text(text, encoding="utf-8")
    except OSError as error:
        raise SetupError(
            f"{folder} cannot be written: {error}",
            hint="choose a folder that is writable, on a disk that is not full",
        ) from error


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
