"""The kinds of film, by the ending of the file's name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

from ludus.errors import ConfigError

__all__ = ["FilmKind", "choose_rate", "film_kind"]

CENTISECONDS = 100
"""A GIF counts time in hundredths of a second."""


@dataclass(frozen=True)
class FilmKind:
    """How a film is encoded.

    Attributes:
        container: Name of the file format.
        codec: Name of the encoder.
        pixels: Format of its pixels.
        max_rate: Frames per second that a film has at most unless more are asked for.
        options: For the encoder.
        container_options: For the file format.
    """

    container: str
    codec: str
    pixels: str
    max_rate: int = 30
    options: Mapping[str, str] = field(default_factory=dict[str, str])
    container_options: Mapping[str, str] = field(default_factory=dict[str, str])

    def can_keep_pace(self, rate: Fraction) -> bool:
        """Tell whether every frame can last equally long."""
        return self.container != "gif" or (CENTISECONDS / rate).denominator == 1


_KINDS = {
    ".mp4": FilmKind(
        "mp4",
        "libx264",
        "yuv420p",
        options={"crf": "20"},
        # The index comes first, so that a browser can begin before it has everything.
        container_options={"movflags": "+faststart"},
    ),
    ".webm": FilmKind(
        "webm",
        "libvpx-vp9",
        "yuv420p",
        options={"crf": "30", "b": "0", "deadline": "good", "cpu-used": "5", "row-mt": "1"},
    ),
    ".gif": FilmKind("gif", "gif", "pal8", max_rate=20),
}


def film_kind(path: Path) -> FilmKind:
    """Return what a file of this name holds.

    Raises:
        ConfigError: The ending is unknown.
    """
    kind = _KINDS.get(path.suffix.lower())
    if kind is None:
        raise ConfigError(
            f"{path.name} ends in {path.suffix or 'nothing'}, expected {' or '.join(_KINDS)}",
            hint="the ending says which kind of film is written: --out film.mp4",
        )
    return kind


def choose_rate(kind: FilmKind, game_rate: Fraction, asked: float | None) -> Fraction:
    """Return the frames per second of the film: the game's own, divided by a whole number.

    So the film takes every frame, every second one, and so on; its pace is steady.

    Args:
        kind: Of film.
        game_rate: Frames per second of the game.
        asked: What the user wants; None: as many as the kind of film usually has.

    Raises:
        ConfigError: ``asked`` is none of them.
    """
    rates = [game_rate / every for every in range(1, max(1, int(game_rate)) + 1)]
    fitting = [rate for rate in rates if kind.can_keep_pace(rate)]
    if asked is None:
        usual = [rate for rate in fitting if rate <= kind.max_rate]
        return (usual or fitting or rates)[0]
    for rate in fitting:
        if abs(rate - asked) < 1e-3:
            return rate
    names = ", ".join(f"{float(rate):g}" for rate in fitting[:8])
    raise ConfigError(
        f"the film cannot have {asked:g} frames a second: the game draws {float(game_rate):g}, "
        f"and each frame of a .{kind.container} must last equally long",
        hint=f"choose one of {names}",
    )
