"""Export templates: the executables from which Godot makes games for Linux.

Godot wants the template to be of the very release that exports. They come from the user cache,
or from where Godot's editor puts those that it downloads itself::

    templates/<kind>/<release>-<route>/template.json     in the user cache
"""

from __future__ import annotations

import json
import logging
import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ludus.engine.cache import cache_root
from ludus.engine.find import InstalledEngine
from ludus.engine.kinds import EngineKind
from ludus.engine.official import platform_key
from ludus.engine.version import release_name
from ludus.errors import SetupError

__all__ = [
    "ExportTemplate",
    "TemplateRecord",
    "cached_templates",
    "find_template",
    "matching_template",
]

RECORD_NAME = "template.json"

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class TemplateRecord:
    """The contents of ``template.json``.

    Attributes:
        version_text: What the template calls itself.
        route: How it came here: ``official`` or ``debian``.
        executable: Path of the template inside the folder.
        prefix: Path inside the folder of the libraries that its games need; empty: none.
    """

    version_text: str
    route: str
    executable: str
    prefix: str

    def write(self, folder: Path) -> None:
        """Make ``folder`` an installed template."""
        (folder / RECORD_NAME).write_text(json.dumps(asdict(self), indent=2), encoding="utf-8")

    @classmethod
    def read(cls, folder: Path) -> TemplateRecord:
        """Read the record of an installed template.

        Raises:
            OSError: There is none.
            ValueError: It is not a record.
        """
        data: Any = json.loads((folder / RECORD_NAME).read_text(encoding="utf-8"))
        try:
            return cls(**{name: str(data[name]) for name in cls.__dataclass_fields__})
        except (KeyError, TypeError) as error:
            raise ValueError(f"record lacks or misspells {error}") from error


@dataclass(frozen=True)
class ExportTemplate:
    """An installed template.

    Attributes:
        path: The executable that Godot copies.
        version_text: What it calls itself.
        source: Where it was found: ``cache …`` or ``Godot's own``.
        prefix: The libraries that games made of it need to start on this machine; None if
            those of the system do.
    """

    path: Path
    version_text: str
    source: str
    prefix: Path | None = None

    @classmethod
    def from_cache(cls, folder: Path, record: TemplateRecord) -> ExportTemplate:
        """Describe a template that lies in the user cache."""
        return cls(
            path=folder / record.executable,
            version_text=record.version_text,
            source=f"cache ({record.route})",
            prefix=folder / record.prefix if record.prefix else None,
        )

    def fits(self, engine: InstalledEngine) -> bool:
        """Tell whether the engine can export with it: both must be of one release."""
        return release_name(self.version_text) == release_name(engine.version_text)


def find_template(engine: InstalledEngine) -> ExportTemplate:
    """Find the template to export with.

    Raises:
        SetupError: There is none of this engine's release; the text lists those of others.
    """
    template = matching_template(engine)
    if template is not None:
        return template
    others = [f"{other.version_text} ({other.source})" for other in cached_templates(engine.kind)]
    raise SetupError(
        f"there is no export template for {engine.path}, which is {engine.version_text}; "
        f"there are templates of: {', '.join(others) or 'no release'}",
        hint=f"ludus engine install {engine.kind} --templates; for an engine of your own, "
        "Editor > Manage Export Templates",
    )


def matching_template(engine: InstalledEngine) -> ExportTemplate | None:
    """Return the template to export with, or None; one whose games run anywhere goes first."""
    found = [template for template in cached_templates(engine.kind) if template.fits(engine)]
    found += _godots_own(engine)
    return min(found, key=lambda template: template.prefix is not None, default=None)


def cached_templates(kind: EngineKind) -> list[ExportTemplate]:
    """List the complete installations in the user cache."""
    root = cache_root()
    folders = sorted((root / "templates" / kind).glob("[!.]*")) if root else []
    found = [(folder, _record_or_none(folder)) for folder in folders]
    return [ExportTemplate.from_cache(folder, record) for folder, record in found if record]


def _record_or_none(folder: Path) -> TemplateRecord | None:
    if not (folder / RECORD_NAME).is_file():
        return None
    try:
        record = TemplateRecord.read(folder)
    except (OSError, ValueError) as error:
        _log.warning("ignoring %s: %s", folder / RECORD_NAME, error)
        return None
    return record if (folder / record.executable).is_file() else None


def _godots_own(engine: InstalledEngine) -> list[ExportTemplate]:
    """Look where the editor puts the templates that it downloads (on Linux)."""
    data = Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share")
    release = release_name(engine.version_text)
    name = "linux_release." + platform_key().removeprefix("linux-")
    path = data / "godot" / "export_templates" / release / name
    return [ExportTemplate(path, release, "Godot's own")] if path.is_file() else []
