"""Export a Godot 4 project as a game for Linux.

The work is done in a copy of the project, so that the project on disk, its own export presets
included, stays as it is.
"""

from __future__ import annotations

import re
import shutil
from pathlib import Path

from ludus.engine.config_file import quote_string
from ludus.engine.find import find_engine
from ludus.engine.kinds import EngineKind
from ludus.engine.launch import LaunchConfig
from ludus.engine.official import platform_key
from ludus.engine.output import mark_errors
from ludus.engine.prefix import bind_to_prefix
from ludus.engine.process import EngineProcess
from ludus.engine.project import Project, find_project
from ludus.engine.template import ExportTemplate, find_template
from ludus.errors import EngineStartError, EngineTimeout, SetupError, TargetError
from ludus.locks import TemporaryFolder

__all__ = ["export_game"]

DEFAULT_TIMEOUT_S = 300.0

_PRESET_NAME = "ludus"
_FEATURE = "ludus"
"""Custom feature of presets; the add-on of Godot 4 knows it as well."""
# All resources: those that a game loads by a path made at run time would be missing otherwise.
_PRESET = """\
[preset.0]

name="{name}"
platform="Linux"
runnable=true
export_filter="all_resources"
include_filter={include}
exclude_filter=""
custom_features="{features}"

[preset.0.options]

custom_template/release={template}
binary_format/embed_pck=false
binary_format/architecture="{architecture}"
"""
_NOT_COPIED = frozenset({".git", ".godot"})
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")
# Errors that Godot reports when it shuts down say nothing about the game.
_TEARDOWN = re.compile(r"at exit|were leaked")
_NUM_KEPT_LINES = 10_000
_NUM_SHOWN_LINES = 20


def export_game(
    project: Path | str,
    output: Path | str,
    *,
    godot: Path | str | None = None,
    include: tuple[str, ...] = ("*.json",),
    is_trainable: bool = True,
    timeout_s: float = DEFAULT_TIMEOUT_S,
) -> Path:
    """Export a project: an executable for this machine, and its data (``.pck``) beside it.

    The game has all resources of the project, and runs its main scene. If the template came
    from Debian's packages, the game runs on this machine only, with libraries from the user
    cache.

    Args:
        project: Folder of ``project.godot``.
        output: Executable to write, such as ``build/game.x86_64``; its folder is made.
        godot: Engine to use instead of looking for one.
        include: Patterns of further files to export, which are not resources.
        is_trainable: Give the game the custom feature ``ludus``, so that it can be trained;
            without it the game plays its policies, and listens to nobody.
        timeout_s: How long Godot may take, its import of the project included.

    Returns:
        The absolute path of the executable.

    Raises:
        TargetError: There is no project, or it is not one for Godot 4.
        EngineNotFound: There is no engine on this machine.
        SetupError: There is no export template for the engine, or a folder cannot be written.
        EngineStartError: Godot reported errors, or wrote no game; ``output`` is not touched.
        EngineTimeout: Godot did not end within ``timeout_s`` seconds.
    """
    found = find_project(Path(project))
    if found.engine_kind is not EngineKind.GODOT4:
        raise TargetError(f"{found.root} is a project for {found.engine_kind.traits.label}")
    engine = find_engine(found.engine_kind, godot)
    template = find_template(engine)
    output = Path(output).expanduser().absolute()
    try:
        with TemporaryFolder("export") as temporary:
            features = _FEATURE if is_trainable else ""
            copy = _copy_project(found, temporary.path, template, include, features)
            built = copy.parent / "game" / output.name
            built.parent.mkdir()
            _run_godot(engine.path, copy, built, timeout_s)
            if template.prefix is not None:
                bind_to_prefix(built, template.prefix)
            output.parent.mkdir(parents=True, exist_ok=True)
            for part in built.parent.iterdir():  # the game, its data, libraries of extensions
                target = output.with_name(part.name)
                target.unlink(missing_ok=True)
                shutil.move(part, target)
    except OSError as error:
        raise SetupError(f"{found.root} cannot be exported to {output}: {error}") from error
    return output


def _copy_project(
    project: Project,
    folder: Path,
    template: ExportTemplate,
    include: tuple[str, ...],
    features: str,
) -> Path:
    copy = folder / "project"
    shutil.copytree(project.root, copy, ignore=_not_copied, ignore_dangling_symlinks=True)
    preset = _PRESET.format(
        name=_PRESET_NAME,
        include=quote_string(", ".join(include)),
        features=features,
        template=quote_string(str(template.path)),
        architecture=platform_key().removeprefix("linux-"),
    )
    (copy / "export_presets.cfg").write_text(preset, encoding="utf-8")
    return copy


def _not_copied(folder: str, names: list[str]) -> set[str]:
    """Leave out caches, and links to folders that contain them."""
    inside = Path(folder).resolve()
    links = {name for name in names if Path(folder, name).is_symlink()}
    leads_back = {name for name in links if inside.is_relative_to(Path(folder, name).resolve())}
    return leads_back | (_NOT_COPIED & set(names))


def _run_godot(godot: Path, project: Path, built: Path, timeout_s: float) -> None:
    options = ("--headless", "--quiet", "--path", str(project))
    command = (str(godot), *options, "--export-release", _PRESET_NAME, str(built))
    config = LaunchConfig(command=command, num_last_lines=_NUM_KEPT_LINES)
    with EngineProcess.start(config) as process:
        code = process.wait(timeout_s)
        report = process.describe_death()
        lines = [_COLOUR.sub("", line) for line in process.last_lines() if line.strip()]
    if code is None:
        raise EngineTimeout(
            f"the export did not end within {timeout_s:g} s: {report}",
            hint="export the project in the editor once, and see what takes so long",
        )
    problems = lines or ["it printed nothing"]
    if code == 0:
        # Godot may report success although it left out what it could not load.
        errors = [line[4:] for line in mark_errors(lines) if line.startswith("  !")]
        problems = [line for line in errors if not _TEARDOWN.search(line)]
        for part in (built, built.with_suffix(".pck")):
            if not part.is_file() or part.stat().st_size == 0:
                problems.append(f"it wrote no {part.name}")
    if problems:
        shown = "\n".join(f"  {line}" for line in problems[:_NUM_SHOWN_LINES])
        raise EngineStartError(
            f"Godot could not export the project (exit code {code}):\n{shown}",
            hint="res:// is the project's folder; open the files with errors in the editor",
        )
