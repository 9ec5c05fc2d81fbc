"""Pack the add-on as the Asset Library wants it: one zip for each version of Godot."""

from __future__ import annotations

import sys
import zipfile
from pathlib import Path

from ludus.addon import ADDON_PATH
from ludus.version import __version__

ROOT = Path(__file__).resolve().parents[1]
EXTRAS = {
    "LICENSE": ROOT / "LICENSE",
    "README.md": ROOT / "engines/addon_readme.md",
    "CHANGELOG.md": ROOT / "CHANGELOG.md",
    "icon.svg": ROOT / "engines/godot4/icon.svg",
}
# The same files give the same bytes, whenever they are packed.
DATE = (1980, 1, 1, 0, 0, 0)


def pack(kind: str, folder: Path) -> Path:
    """Write the zip of ``godot4`` or ``godot3`` into a folder and return its path."""
    folder.mkdir(parents=True, exist_ok=True)
    source = ROOT / "engines" / kind / ADDON_PATH
    files = {path.relative_to(source).as_posix(): path for path in source.rglob("*")}
    files = {name: path for name, path in files.items() if path.is_file()} | EXTRAS
    target = folder / f"ludus-{__version__}-{kind}.zip"
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(files):
            entry = zipfile.ZipInfo(f"{ADDON_PATH}/{name}", DATE)
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, files[name].read_bytes(), zipfile.ZIP_DEFLATED)
    return target


if __name__ == "__main__":
    for kind in ("godot4", "godot3"):
        sys.stdout.write(f"{pack(kind, ROOT / 'build')}\n")
