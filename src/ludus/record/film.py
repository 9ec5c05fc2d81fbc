"""A film: frames in, a video file out, encoded in this process."""

from __future__ import annotations

import os
from collections.abc import Generator
from contextlib import contextmanager, suppress
from fractions import Fraction
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ludus.errors import ConfigError, RunError, UsageError
from ludus.extras import missing_extra
from ludus.record.film_kinds import FilmKind, film_kind

if TYPE_CHECKING:
    from ludus.record.palette import Palette

__all__ = ["Film", "Frame", "check_out"]

Frame = NDArray[np.uint8]
"""``uint8[height, width, 3]``, red, green, blue; the first row is at the top."""


class Film:
    """Writes a ``.mp4``, ``.webm`` or ``.gif``; the ending says which.

    The file is replaced only once the film is complete; an error leaves nothing behind.

    ::

        with Film("film.mp4", frames_per_second=30) as film:
            film.add(frame)

    Args:
        path: Where to write; an older file is replaced at the end.
        frames_per_second: Pace; every frame lasts equally long.
        width: Of the film, pixels; the height follows. None: as the first frame has it. Both
            are made even, which videos need.

    Attributes:
        num_frames: Frames so far.

    Raises:
        ConfigError: The ending or a number is wrong, or there is no such folder.
        SetupError: PyAV is missing.
    """

    def __init__(
        self, path: str | Path, frames_per_second: float | Fraction = 30, width: int | None = None
    ) -> None:
        self.path = Path(path)
        self.num_frames = 0
        self._kind = film_kind(self.path)
        self._rate = Fraction(frames_per_second).limit_denominator(1000)
        self._width = width
        check_out(self.path)
        if self._rate <= 0:
            raise ConfigError(f"a film needs more than {float(self._rate):g} frames a second")
        if width is not None and width < 2:
            raise ConfigError(f"the width of a film must be at least 2 pixels, not {width}")
        self._incoming = self.path.with_name(f".{self.path.name}.{os.getpid()}.incoming")
        self._container: Any = None
        self._stream: Any = None
        self._palette: Palette | None = None

    def add(self, frame: Frame) -> None:
        """Append one frame; a later one of another size is scaled to the first one's.

        Raises:
            UsageError: It is not ``uint8[height, width, 3]``.
            RunError: The disk is full, or the like.
        """
        import av

        if frame.ndim != 3 or frame.shape[2] != 3 or frame.dtype != np.uint8:
            raise UsageError(
                f"a frame must be uint8[height, width, 3], got {frame.dtype}{list(frame.shape)}"
            )
        with _disk_errors(self.path):
            if self._container is None:
                self._open(frame)
            picture = av.VideoFrame.from_ndarray(np.ascontiguousarray(frame), format="rgb24")
            self._take(picture)
        self.num_frames += 1

    def close(self) -> None:
        """Write what is left and give the file its name.

        Raises:
            UsageError: There was no frame.
            RunError: The disk is full, or the like.
        """
        if self._container is None:
            raise UsageError(f"{self.path} would have no frames", hint="add at least one frame")
        with _disk_errors(self.path):
            if self._palette is not None:
                for picture in self._palette.pictures():
                    self._encode(picture)
            self._encode(None)
            self._container.close()
            self._incoming.replace(self.path)
        self._container = None

    def discard(self) -> None:
        """Leave nothing behind; may be called twice."""
        container, self._container = self._container, None
        if container is not None:
            from av.error import FFmpegError

            # The end of the file cannot be written, say because the disk is full; no matter.
            with suppress(OSError, FFmpegError):
                container.close()
        self._incoming.unlink(missing_ok=True)

    def __enter__(self) -> Film:
        return self

    def __exit__(self, _: object, error: BaseException | None, __: object) -> None:
        try:
            if error is None:
                self.close()
        finally:
            self.discard()

    def _open(self, frame: Frame) -> None:
        import av

        kind = self._kind
        self._container = av.open(
            str(self._incoming), "w", format=kind.container, options=dict(kind.container_options)
        )
        self._stream = self._container.add_stream(kind.codec, rate=self._rate)
        height, full_width = frame.shape[:2]
        width = full_width if self._width is None else self._width
        self._stream.width = max(2, width // 2 * 2)
        self._stream.height = max(2, round(height * width / full_width / 2) * 2)
        self._stream.pix_fmt = kind.pixels
        self._stream.options = dict(kind.options)
        if kind.pixels == "pal8":
            from ludus.record.palette import Palette

            self._palette = Palette(self._stream.width, self._stream.height, self._rate)

    def _take(self, picture: Any) -> None:
        size: dict[str, Any] = {"width": self._stream.width, "height": self._stream.height}
        if self._palette is not None:
            self._palette.add(picture.reformat(**size, format="rgb24", interpolation="AREA"))
            return
        picture = picture.reformat(**size, format=self._kind.pixels, interpolation="AREA")
        picture.pts = self.num_frames
        picture.time_base = 1 / self._rate
        self._encode(picture)

    def _encode(self, picture: Any) -> None:
        for packet in self._stream.encode(picture):
            self._container.mux(packet)


def check_out(path: Path) -> FilmKind:
    """Check that a film can be written there; return its kind.

    Raises:
        ConfigError: The ending is unknown, or there is no such folder.
        SetupError: PyAV is missing.
    """
    kind = film_kind(path)
    if not path.parent.is_dir():
        raise ConfigError(
            f"there is no folder {path.parent} for the film", hint=f"mkdir -p {path.parent}"
        )
    if path.is_dir() or not os.access(path.parent, os.W_OK):
        raise ConfigError(f"the film {path} cannot be written", hint="name another file with --out")
    if find_spec("av") is None:
        raise missing_extra("av")
    return kind


@contextmanager
def _disk_errors(path: Path) -> Generator[None]:
    from av.error import FFmpegError

    try:
        yield
    except (OSError, FFmpegError) as error:
        raise RunError(
            f"the film {path} could not be written: {error}",
            hint="check that the disk is not full and that the folder still exists",
        ) from error
