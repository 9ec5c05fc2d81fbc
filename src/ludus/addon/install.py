"""Install the Ludus add-on in a Godot project, upgrade it there, and enable it.

A manifest beside the add-on's files records what was installed. Files that the user changed
since are overwritten only on request, and files that the user added are kept.
"""

from __future__ import annotations

import hashlib
import json
import logging
import shutil
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

from ludus.addon.references import find_dropped, moved_scripts, rewrite_references
from ludus.disk import read_json, write_atomically
from ludus.engine.bundled import bundled_root, package_version
from ludus.engine.config_file import add_string, add_to_string_array, parse_config
from ludus.engine.kinds import EngineKind
from ludus.engine.project import PROJECT_FILE, find_project, read_project
from ludus.engine.script_classes import (
    add_script_classes,
    drop_missing_classes,
    find_script_classes,
)
from ludus.errors import ConfigError, SetupError

__all__ = [
    "ADDON_PATH",
    "GDRL_PATH",
    "LEGACY_PATH",
    "MANIFEST_NAME",
    "PLUGIN",
    "AddonChange",
    "AddonStatus",
    "addon_status",
    "install_addon",
    "install_folder",
    "read_project_file",
    "remove_folder",
    "write_project_file",
]

ADDON_PATH = "addons/ludus"
LEGACY_PATH = "addons/ludus_classic"
GDRL_PATH = "addons/ludus_gdrl"
MANIFEST_NAME = ".ludus_manifest.json"
PLUGIN = "res://addons/ludus/plugin.cfg"

_ENABLED_KEY = "editor_plugins/enabled"
_AUTOLOAD_KEY = "autoload/Ludus"
_BRIDGES = {
    EngineKind.GODOT4: f"res://{ADDON_PATH}/bridge/ludus_bridge.gd",
    EngineKind.GODOT3: f"res://{ADDON_PATH}/ludus_bridge.gd",
}
_ARRAY_TYPES = {EngineKind.GODOT4: "PackedStringArray", EngineKind.GODOT3: "PoolStringArray"}
_SIGNS = {
    EngineKind.GODOT4: {
        ADDON_PATH: "plugin.cfg",
        LEGACY_PATH: "ai_runner.gd",
        GDRL_PATH: "sync.gd",
    },
    EngineKind.GODOT3: {ADDON_PATH: "plugin.cfg", LEGACY_PATH: "gym_godot.gd"},
}
"""A file that every complete folder of the add-on contains."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class AddonStatus:
    """The add-on in a project.

    Attributes:
        version: Version that was installed; None if there is no add-on, or one without a
            manifest.
        is_present: Whether there is an add-on at all.
        is_enabled: Whether it is enabled in ``project.godot``.
        is_current: Whether all its files equal those bundled with this version of Ludus.
        changed: Files that differ from what was installed, relative to the add-on.
    """

    version: str | None
    is_present: bool
    is_enabled: bool
    is_current: bool
    changed: tuple[str, ...]


@dataclass(frozen=True)
class AddonChange:
    """What an installation did.

    Attributes:
        version_before: Version that was installed; None if unknown or none.
        version_after: Version that is installed now.
        added: New files, relative to the add-on.
        updated: Files that were replaced.
        removed: Files that are not part of this version.
        rewritten: Scenes, resources, scripts and settings of the project, relative to it, in
            which the paths of scripts that have moved were replaced.
        has_enabled_plugin: Whether ``project.godot`` was changed to enable it.
    """

    version_before: str | None
    version_after: str
    added: tuple[str, ...] = ()
    updated: tuple[str, ...] = ()
    removed: tuple[str, ...] = ()
    rewritten: tuple[str, ...] = ()
    has_enabled_plugin: bool = False


@dataclass
class _Files:
    """SHA-256 by path relative to the add-on's folder."""

    bundled: dict[str, str]
    present: dict[str, str]
    recorded: dict[str, str] = field(default_factory=dict[str, str])
    version: str | None = None

    def changed(self) -> list[str]:
        """List files that the user altered and that an installation would overwrite or remove."""
        return sorted(
            name
            for name in self.present.keys() & (self.bundled.keys() | self.recorded.keys())
            if self.present[name] not in {self.bundled.get(name), self.recorded.get(name)}
        )

    def own(self) -> list[str]:
        """List files that the user added, which an installation keeps."""
        ours = self.bundled.keys() | self.recorded.keys()
        return sorted(name for name in self.present if name not in ours)


def addon_status(project: Path) -> AddonStatus:
    """Examine the add-on of a project.

    Raises:
        TargetError: There is no Godot project.
    """
    root = find_project(project).root
    files = _survey(_bundled_addon(root, ADDON_PATH), root / ADDON_PATH)
    return AddonStatus(
        version=files.version,
        is_present=bool(files.present),
        is_enabled=PLUGIN in parse_config(read_project_file(root)).strings(_ENABLED_KEY),
        is_current=all(files.present.get(name) == sha for name, sha in files.bundled.items()),
        changed=tuple(files.changed()),
    )


def install_addon(project: Path, *, force: bool = False) -> AddonChange:
    """Copy the add-on for the project's version of Godot into the project and enable it.

    The new folder is prepared beside the old one and takes its place at the end, so that a
    failure half-way leaves the old one. Files that belong to an older version only are removed,
    and scenes, scripts and settings that name a script which has moved since are rewritten.
    Repeating the installation changes nothing. The classes of legacy bridges
    (:data:`LEGACY_PATH`, :data:`GDRL_PATH`) are upgraded too if the project has them.

    Args:
        project: Folder of the project, or anything inside it.
        force: Overwrite files that were changed by hand.

    Raises:
        TargetError: There is no Godot project.
        ConfigError: Files were changed by hand, the folder is a link, or a Godot 3 project uses
            what its add-on no longer has. Nothing was changed.
        SetupError: The project cannot be written.
    """
    found = find_project(project)
    root = found.root
    _refuse_link(root / PROJECT_FILE, root)
    for path in _SIGNS[found.engine_kind]:
        if path != ADDON_PATH and (root / path).is_dir():
            install_folder(root, path, force=force)
    change = install_folder(root, ADDON_PATH, force=force)
    moved = moved_scripts(_hashes(_bundled_addon(root, ADDON_PATH)))
    with _disk_errors(root):
        rewritten = rewrite_references(root, ADDON_PATH, moved)
        return replace(change, rewritten=rewritten, has_enabled_plugin=_enable(root))


def install_folder(root: Path, path: str, *, force: bool) -> AddonChange:
    """Copy one folder of the add-on, as :func:`install_addon` does, without enabling it.

    Args:
        root: Folder of the project.
        path: :data:`ADDON_PATH`, :data:`LEGACY_PATH` or :data:`GDRL_PATH`.
        force: Overwrite files that were changed by hand.

    Raises:
        ConfigError: Files were changed by hand, the folder is a link, or a Godot 3 project uses
            what its add-on no longer has.
        SetupError: The project cannot be written.
    """
    source, target = _bundled_addon(root, path), root / path
    files = _survey(source, target)
    if read_project(root).engine_kind is EngineKind.GODOT3:
        _refuse_dropped(root, files.version)
    is_bundled = target.resolve() == source.resolve()
    if not is_bundled:
        for place in (target, target.parent):
            _refuse_link(place, root)
    if not force:
        _refuse_changed(path, files.changed())
    new, old, version = files.bundled, files.present, package_version()
    change = AddonChange(
        version_before=files.version,
        version_after=version,
        added=tuple(sorted(new.keys() - old.keys())),
        updated=tuple(sorted(name for name in new.keys() & old.keys() if new[name] != old[name])),
        removed=tuple(sorted(files.recorded.keys() & old.keys() - new.keys())),
    )
    is_current = files.recorded == new and files.version == version
    if not is_bundled and (not is_current or change.added or change.updated):
        with _disk_errors(root):
            _swap_in(source, target, files, version)
    return change


def remove_folder(root: Path, path: str, *, force: bool) -> None:
    """Remove a folder that :func:`install_folder` has made.

    Raises:
        ConfigError: Files in it were changed or added by hand, or it is a link.
        SetupError: The project cannot be written.
    """
    target = root / path
    _refuse_link(target, root)
    files = _survey(_bundled_addon(root, path), target)
    if not force:
        _refuse_changed(path, sorted({*files.changed(), *files.own()}))
    with _disk_errors(root):
        shutil.rmtree(target, ignore_errors=not target.exists())


def _refuse_changed(path: str, names: list[str]) -> None:
    if names:
        rows = "\n".join(f"  {path}/{name}" for name in names)
        raise ConfigError(
            f"these files of the add-on were changed by hand:\n{rows}",
            hint="use --force to overwrite them, or move your changes out of the add-on",
        )


def _refuse_link(path: Path, root: Path) -> None:
    """Refuse a link in the place of a folder of the add-on, or of the project's file.

    In a project from somebody else it could point anywhere, to be written to or copied from.
    """
    if path.is_symlink():
        where = path.relative_to(root).as_posix()
        raise ConfigError(
            f"{where} in {root} is a link to {path.readlink()}",
            hint="put the folder or file itself there, then try again",
        )


def _refuse_dropped(root: Path, installed: str | None) -> None:
    found = find_dropped(root, ADDON_PATH)
    if not found:
        return
    rows = "\n".join(f"  {name}" for name in found)
    raise ConfigError(
        "the add-on for Godot 3 no longer has simulations in code and guided training "
        f"(LudusSimulation, LudusTraining, Ludus.start_training), which these files use:\n{rows}",
        hint=f"keep the add-on of version {installed or '0.1.0'}, the last that has them: "
        "`ludus train` goes on training games that have it; or move the game to Godot 4",
    )


@contextmanager
def _disk_errors(root: Path) -> Generator[None, None, None]:
    try:
        yield
    except OSError as error:
        raise SetupError(
            f"the add-on could not be installed in {root}: {error}",
            hint="the project folder must be writable, and the disk not full",
        ) from error


def _survey(source: Path, target: Path) -> _Files:
    files = _Files(_hashes(source), _hashes(target))
    try:
        data: Any = read_json(target / MANIFEST_NAME)
        files.recorded = {str(name): str(sha) for name, sha in data["files"].items()}
        files.version = str(cast("dict[str, Any]", data)["version"])
    except FileNotFoundError:
        pass
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        _log.warning("ignoring %s: %r", target / MANIFEST_NAME, error)
    return files


def _bundled_addon(root: Path, path: str) -> Path:
    kind = read_project(root).engine_kind
    source = bundled_root(kind) / path
    if not (source / _SIGNS[kind][path]).is_file():
        raise SetupError(
            f"this installation of Ludus lacks its add-on ({source / _SIGNS[kind][path]})",
            hint="install Ludus again: pip install --force-reinstall ludus-rl",
        )
    return source


def _hashes(folder: Path) -> dict[str, str]:
    """Hash every file; line ends do not count, because git may convert them."""
    found: dict[str, str] = {}
    for file in sorted(folder.rglob("*")):
        name = file.relative_to(folder).as_posix()
        if file.is_symlink():  # stays one, and is a change if it is in the place of our file
            found[name] = f"link to {file.readlink()}"
        elif file.is_file() and name != MANIFEST_NAME and ".godot" not in file.parts:
            content = file.read_bytes().replace(b"\r\n", b"\n")
            found[name] = hashlib.sha256(content).hexdigest()
    return found


def _swap_in(source: Path, target: Path, files: _Files, version: str) -> None:
    """Prepare the new folder beside the old one, then rename it to take the old one's place."""
    target.parent.mkdir(parents=True, exist_ok=True)
    incoming = Path(tempfile.mkdtemp(prefix=".ludus-", dir=target.parent))
    try:
        prepared, old = incoming / "new", incoming / "old"
        for name in files.bundled:
            _copy_file(source / name, prepared / name)
        for name in files.own():
            _copy_file(target / name, prepared / name)
        manifest = {"version": version, "files": files.bundled}
        text = json.dumps(manifest, indent=2, sort_keys=True) + "\n"
        (prepared / MANIFEST_NAME).write_text(text, encoding="utf-8")
        if target.exists():
            target.rename(old)
        try:
            prepared.rename(target)
        except OSError:
            if old.exists():
                old.rename(target)
            raise
    finally:
        shutil.rmtree(incoming, ignore_errors=True)


def _copy_file(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(source, target, follow_symlinks=False)


def read_project_file(root: Path) -> str:
    """Return ``project.godot`` with its line ends unchanged."""
    with (root / PROJECT_FILE).open(encoding="utf-8", newline="") as file:
        return file.read()


def _enable(root: Path) -> bool:
    """Enable the add-on in ``project.godot``; return whether that changed the file."""
    text = read_project_file(root)
    kind = read_project(root).engine_kind
    enabled = add_to_string_array(text, _ENABLED_KEY, PLUGIN, _ARRAY_TYPES[kind])
    enabled = add_string(enabled, _AUTOLOAD_KEY, f"*{_BRIDGES[kind]}")
    if kind is EngineKind.GODOT3:
        for path in (ADDON_PATH, LEGACY_PATH):
            enabled = drop_missing_classes(enabled, root, f"res://{path}")
            scripts = find_script_classes(root / path, f"res://{path}")
            enabled = add_script_classes(enabled, scripts)
    if enabled == text:
        return False
    write_project_file(root, enabled)
    return True


def write_project_file(root: Path, text: str) -> None:
    """Replace ``project.godot`` in one step, so that it is never half-written.

    Raises:
        OSError: It cannot be written.
    """
    file = root / PROJECT_FILE
    mode = file.stat().st_mode
    write_atomically(file, text.encode())
    file.chmod(mode)
