"""Unpack a zip archive without letting it write outside the folder."""

from __future__ import annotations

import shutil
import stat
import zipfile
from collections.abc import Container
from pathlib import Path, PurePosixPath

from ludus.errors import SetupError

__all__ = ["unpack_zip"]


def unpack_zip(archive: Path, folder: Path, only: Container[str] | None = None) -> None:
    """Unpack ``archive`` into ``folder``, keeping the executable bits.

    Args:
        archive: A zip archive.
        folder: Where its entries go.
        only: Names of the entries to unpack; None unpacks all.

    Raises:
        SetupError: It is not a zip archive, is damaged, or has an entry outside the folder.
        OSError: The disk is full, or the folder not writable.
    """
    try:
        with zipfile.ZipFile(archive) as opened:
            for entry in opened.infolist():
                if only is None or entry.filename in only:
                    _unpack_entry(opened, entry, folder)
    except (zipfile.BadZipFile, EOFError) as error:
        raise SetupError(f"{archive.name} is not a valid zip archive: {error}") from error


def _unpack_entry(opened: zipfile.ZipFile, entry: zipfile.ZipInfo, folder: Path) -> None:
    path = PurePosixPath(entry.filename.replace("\\", "/"))
    mode = entry.external_attr >> 16
    has_drive = any(":" in part for part in path.parts)
    if path.is_absolute() or ".." in path.parts or has_drive or stat.S_ISLNK(mode):
        raise SetupError(f"the archive has an entry outside its folder: {entry.filename!r}")
    target = folder / path
    if entry.is_dir():
        target.mkdir(parents=True, exist_ok=True)
        return
    target.parent.mkdir(parents=True, exist_ok=True)
    with opened.open(entry) as source, target.open("wb") as file:
        shutil.copyfileobj(source, file, 1 << 20)
    if mode & 0o111:
        target.chmod(0o755)
