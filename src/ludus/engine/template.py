"""Export templates: the executables from which Godot makes games for Linux.

Godot requires a template of exactly its own release. Templates come from the user cache, or from
the folder in which Godot's editor keeps those that it downloads itself.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from ludus.engine.cache import TemplateRecord
from ludus.engine.find import InstalledEngine
from ludus.engine.kinds import EngineKind
from ludus.engine.official import platform_key
from ludus.engine.version import release_name
from ludus.errors import SetupError

__all__ = [
    "ExportTemplate",
    "cached_templates",
    "find_template",
    "matching_template",
]


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
    others = [f"{other.version_text} ({other.source})" for other in cached_templates()]
    raise SetupError(
        f"there is no export template for {engine.path}, which is {engine.version_text}; "
        f"there are templates of: {', '.join(others) or 'no release'}",
        hint=f"ludus engine install {engine.kind} --templates; for an engine of your own, "
        "Editor > Manage Export Templates",
    )


def matching_template(engine: InstalledEngine) -> ExportTemplate | None:
    """Return the template to export with, or None; one whose games run anywhere goes first."""
    found = [template for template in cached_templates() if template.fits(engine)]
    found += _godots_own(engine)
    return min(found, key=lambda template: template.prefix is not None, default=None)


def cached_templates() -> list[ExportTemplate]:
    """List the complete installations in the user cache."""
    found = TemplateRecord.read_all(f"templates/{EngineKind.GODOT4}")
    return [ExportTemplate.from_cache(folder, record) for folder, record in found]


def _godots_own(engine: InstalledEngine) -> list[ExportTemplate]:
    """Look where the editor puts the templates that it downloads (on Linux)."""
    data = Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share")
    release = release_name(engine.version_text)
    name = "linux_release." + platform_key().removeprefix("linux-")
    path = data / "godot" / "export_templates" / release / name
    return [ExportTemplate(path, release, "Godot's own")] if path.is_file() else []
