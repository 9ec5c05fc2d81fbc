"""Files that messages name: those of the game's project, and no others."""

from __future__ import annotations

import json
import os
from pathlib import Path, PurePath
from typing import Any

from ludus.disk import disk_errors
from ludus.errors import ProtocolError
from ludus.serve.godot_ai.fields import Fields, short
from ludus.wire.godot_json import parse_godot_json

__all__ = ["ProjectFiles", "has_foreign_drive"]

FOLDER = "AIServerCommFiles"
_GIT_IGNORE = (
    "# Bulk data and checkpoints; policies belong to the game.\n*\n!*_policy.json\n!*.ludus.json\n"
)
MAX_FILE_BYTES = 1 << 30

_HINT = "paths in messages stay inside the folder that ludus serve --project names"


class ProjectFiles:
    """Reads and writes JSON below one folder; links that lead out of it do not.

    Args:
        root: Folder of the project.

    Attributes:
        root: The same, without links.
        folder: Where bulk data lies.
    """

    def __init__(self, root: Path) -> None:
        self.root = root.resolve()
        self.folder = self.root / FOLDER
        with disk_errors(str(self.folder)):
            self.folder.mkdir(exist_ok=True)
            if not (mark := self.folder / ".gitignore").exists():
                mark.write_text(_GIT_IGNORE, encoding="utf-8")

    def find(self, path: str) -> Path:
        """Return where a path in a message leads.

        Args:
            path: Relative to the project, absolute, or ``res://…``.

        Raises:
            ProtocolError: It leads out of the project.
        """
        if has_foreign_drive(self.root, path):
            raise ProtocolError(f"the path {short(path)} leads out of the project", _HINT)
        try:
            found = (self.root / path.removeprefix("res://")).resolve()
        except (OSError, ValueError, RuntimeError) as error:  # NUL bytes, links in a circle
            raise ProtocolError(f"{short(path)} is not a path: {error}", _HINT) from None
        if not found.is_relative_to(self.root):
            raise ProtocolError(f"the path {short(path)} leads out of the project", _HINT)
        return found

    def read(self, path: str) -> Fields:
        """Return the object in a file.

        Raises:
            ProtocolError: It leads out of the project, is missing, too large, or not JSON object.
        """
        found = self.find(path)
        if not found.is_file():
            raise ProtocolError(
                f"there is no file {short(path)} in the project",
                f"--project must be the folder that the game runs in, not {self.root}",
            )
        try:
            with found.open("rb") as file:
                data = file.read(MAX_FILE_BYTES + 1)
        except OSError as error:
            raise ProtocolError(f"{path} cannot be read: {error.strerror}") from error
        if len(data) > MAX_FILE_BYTES:
            raise ProtocolError(f"{path} has more than {MAX_FILE_BYTES} bytes")
        try:
            value = parse_godot_json(data)
        except ValueError as error:
            raise ProtocolError(f"{path} is not JSON: {error}") from error
        return Fields(value, path)

    def write(self, name: str, values: dict[str, Any]) -> str:
        """Write a file into the folder for bulk data, whole or not at all.

        It is not synced: after a power cut the game asks again.

        Returns:
            Its path for a message.

        Raises:
            ProtocolError: The folder leads out of the project.
            RunError: It cannot be written.
        """
        path = f"{FOLDER}/{name}"
        found = self.find(path)
        temporary = found.with_name(f".{name}.{os.getpid()}.tmp")
        with disk_errors(path):
            try:
                temporary.write_text(json.dumps(values), encoding="utf-8")
                temporary.replace(found)
            finally:
                temporary.unlink(missing_ok=True)
        return path


def has_foreign_drive(root: PurePath, path: str) -> bool:
    r"""Tell whether a path names another drive than ``root``, as only paths of Windows can.

    To resolve ``\\server\share`` would log in there, with the user's name and password.
    """
    drive = type(root)(path).drive
    return drive != "" and drive.lower() != root.drive.lower()
