"""Let Godot import a project's resources before the first run, and only when needed.

Godot loads scripts by class name, textures and the like from ``.godot/``, which only an import
fills. A stamp in there records which files the last import saw.
"""

from __future__ import annotations

import hashlib
import logging
import os
from collections.abc import Iterator
from pathlib import Path

from ludus.disk import write_atomically
from ludus.engine.find import InstalledEngine
from ludus.engine.kinds import EngineKind
from ludus.engine.launch import LaunchConfig
from ludus.engine.process import EngineProcess
from ludus.engine.project import Project
from ludus.errors import EngineStartError, EngineTimeout, SetupError
from ludus.locks import file_lock

__all__ = ["STAMP_NAME", "ensure_imported", "needs_import"]

STAMP_NAME = "ludus_import_stamp"
DEFAULT_TIMEOUT_S = 300.0

# The import itself writes these beside the resources.
_GENERATED_SUFFIXES = (".import", ".uid")
_log = logging.getLogger(__name__)


def ensure_imported(
    engine: InstalledEngine, project: Project, *, timeout_s: float = DEFAULT_TIMEOUT_S
) -> bool:
    """Import the project's resources unless that has been done since the last change.

    Several processes may call this at once: one imports, the others wait. Godot 3 imports
    nothing without an editor window, so for it this does nothing.

    Returns:
        Whether an import was necessary.

    Raises:
        EngineStartError: The import failed; the text holds its last log lines.
        EngineTimeout: The import did not end within ``timeout_s`` seconds.
        SetupError: The project folder cannot be written.
    """
    if not needs_import(engine, project):
        return False
    cache = project.root / ".godot"
    try:
        with file_lock(cache / "ludus_import.lock", timeout_s):
            if not needs_import(engine, project):
                return False
            _import(engine, project, timeout_s)
    except OSError as error:
        raise SetupError(
            f"the project {project.root} cannot be imported: {error}",
            hint="the project folder must be writable, for its cache in .godot",
        ) from error
    return True


def needs_import(engine: InstalledEngine, project: Project) -> bool:
    """Tell whether files came, went or changed since the last import by this engine."""
    if engine.kind is not EngineKind.GODOT4:
        return False
    stamp = project.root / ".godot" / STAMP_NAME
    try:
        return stamp.read_text(encoding="utf-8") != _fingerprint(engine, project.root)
    except OSError:
        return True


def _import(engine: InstalledEngine, project: Project, timeout_s: float) -> None:
    _log.info("importing %s", project.root)
    stamp = project.root / ".godot" / STAMP_NAME
    # An import that fails, or whose files change while it runs, leaves a cache that matches no
    # state of the files. The old stamp must not confirm it when the files change back.
    stamp.unlink(missing_ok=True)
    before = _fingerprint(engine, project.root, with_generated=False)
    _run_import(engine, project, timeout_s)
    if _fingerprint(engine, project.root, with_generated=False) == before:
        write_atomically(stamp, _fingerprint(engine, project.root).encode())


def _run_import(engine: InstalledEngine, project: Project, timeout_s: float) -> None:
    path = str(engine.executable(headless=True))
    command = (path, "--headless", "--import", "--path", str(project.root))
    with EngineProcess.start(LaunchConfig(command=command)) as process:
        code = process.wait(timeout_s)
        report = process.describe_death()
    if code is None:
        raise EngineTimeout(
            f"the import of {project.root} did not end within {timeout_s:.0f} s\n{report}",
            hint="open the project in the editor once, and see what takes so long",
        )
    if code != 0:
        raise EngineStartError(
            f"the import of {project.root} failed: {report}",
            hint="open the project in the editor once; it shows what cannot be imported",
        )
    _log.debug("import of %s: %s", project.root, report)


def _fingerprint(engine: InstalledEngine, root: Path, *, with_generated: bool = True) -> str:
    digest = hashlib.sha256(engine.version_text.encode())
    for line in sorted(_file_lines(str(root), with_generated)):
        digest.update(line.encode(errors="surrogateescape"))
    return digest.hexdigest()


def _file_lines(folder: str, with_generated: bool) -> Iterator[str]:
    """Yield path, size and time of every file that Godot may import, or what it wrote itself."""
    with os.scandir(folder) as entries:
        listed = [entry for entry in entries if not entry.name.startswith(".")]
        is_ignored = Path(folder, ".gdignore").is_file()
    for entry in () if is_ignored else listed:
        if entry.is_dir():
            if not _leads_back(entry):
                yield from _file_lines(entry.path, with_generated)
        elif with_generated or not entry.name.endswith(_GENERATED_SUFFIXES):
            yield _describe_file(entry)


def _leads_back(folder: os.DirEntry[str]) -> bool:
    """Tell whether a folder is a link to one that contains it."""
    return folder.is_symlink() and Path(folder.path).is_relative_to(os.path.realpath(folder.path))


def _describe_file(entry: os.DirEntry[str]) -> str:
    try:
        if entry.name.endswith(_GENERATED_SUFFIXES):
            # Projects that link to the same add-on rewrite these files for one another, with the
            # same content: times would have each of them imported again after the others.
            return f"{entry.path}\0{Path(entry.path).read_bytes()!r}\n"
        status = entry.stat()
    except OSError:  # a link to nothing, or just deleted
        return f"{entry.path}\0\n"
    return f"{entry.path}\0{status.st_size}\0{status.st_mtime_ns}\n"
