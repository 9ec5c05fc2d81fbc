"""Pictures that the game saves as ``<renderPath>0.png``, ``<renderPath>1.png`` and so on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ludus.errors import ConfigError, GameError
from ludus.legacy.gymgodot.connecting import DEFAULT_RENDER_PATH
from ludus.locks import TemporaryFolder

__all__ = ["Frames", "check_saved"]

_ERROR_NAMES = {
    1: "FAILED",
    2: "ERR_UNAVAILABLE",
    7: "ERR_FILE_NOT_FOUND",
    9: "ERR_FILE_BAD_PATH",
    10: "ERR_FILE_NO_PERMISSION",
    12: "ERR_FILE_CANT_OPEN",
    13: "ERR_FILE_CANT_WRITE",
    19: "ERR_CANT_OPEN",
    20: "ERR_CANT_CREATE",
}


class Frames:
    """Knows which file comes next, since the game counts from 0 after every reset.

    Args:
        render_path: What comes before the number. None: a temporary folder if frames are read
            here, ``./render_frames/`` as the game sees it otherwise.
        are_read: Whether frames are read here.

    Raises:
        ConfigError: The game could not be told this path, or we could not find its files.
    """

    def __init__(self, render_path: str | None, *, are_read: bool) -> None:
        _check(render_path, are_read=are_read)
        self._temporary: TemporaryFolder | None = None
        if render_path is None and are_read:
            self._temporary = TemporaryFolder("frames")
            render_path = f"{self._temporary.path}/"
        self.render_path = DEFAULT_RENDER_PATH if render_path is None else render_path
        self._number = 0

    def restart(self) -> None:
        """Count from 0 again: the game was reset."""
        self._number = 0

    def next_file(self) -> Path:
        """Return the file that the game saves next; it counts failures, too."""
        file = Path(f"{self.render_path}{self._number}.png")
        self._number += 1
        return file

    def read(self, file: Path) -> NDArray[np.uint8]:
        """Return a saved frame; a temporary file is deleted.

        Returns:
            ``uint8[height, width, 3]``.

        Raises:
            GameError: There is no such file, or it is not a picture.
        """
        try:
            with Image.open(file, formats=["PNG"]) as image:
                frame = np.asarray(image.convert("RGB"), np.uint8)
        except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
            raise GameError(
                f"the game says it saved {file}, which cannot be read: {error}",
                hint="a game in a sandbox sees other folders; choose a renderPath that both see",
            ) from error
        if self._temporary is not None:
            file.unlink()
        return frame

    def close(self) -> None:
        """Delete the temporary folder, if there is one; may be called twice."""
        if self._temporary is not None:
            self._temporary.close()


def check_saved(code: int, file: Path) -> None:
    """Raise unless the game saved a frame.

    Raises:
        GameError: ``code`` is not 0.
    """
    if code != 0:
        name = _ERROR_NAMES.get(code, "see Godot's list of errors")
        raise GameError(
            f"the game could not save {file}: error {code} ({name})",
            hint="the folder must exist, and the game must be able to draw (a desktop or Xvfb)",
        )


def _check(render_path: str | None, *, are_read: bool) -> None:
    if render_path is None:
        return
    if "=" in render_path:
        raise ConfigError(
            f"renderPath {render_path!r} holds a '='",
            hint="GymGodot splits its arguments there; choose another folder",
        )
    if are_read and not Path(render_path).is_absolute():
        raise ConfigError(
            f"renderPath {render_path!r} must be absolute to be read with render_mode='rgb_array'",
            hint="the game sees it from another folder; leave it out to use a temporary one",
        )
