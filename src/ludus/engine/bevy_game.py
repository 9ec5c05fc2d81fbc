"""Recognise a game that is made with ``bevy_ludus``, and start it."""

from __future__ import annotations

import mmap
from pathlib import Path

__all__ = ["bevy_command", "is_bevy_game"]

SIGNATURE = b"This game is made with bevy_ludus and speaks the Ludus protocol."
"""What such a game answers to ``--ludus-about``; the bytes are in the executable."""


def is_bevy_game(program: Path) -> bool:
    """Tell whether an executable is made with ``bevy_ludus``; a file that cannot be read is not."""
    try:
        with (
            program.open("rb") as file,
            mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content,
        ):
            return content.find(SIGNATURE) >= 0
    except (OSError, ValueError):  # an empty file cannot be mapped
        return False


def bevy_command(
    program: Path, user_args: tuple[str, ...], *, is_headless: bool, is_real_time: bool
) -> tuple[str, ...]:
    """Build the command line of such a game: it knows none of Godot's switches.

    Args:
        program: The game.
        user_args: Arguments for the add-on.
        is_headless: Open no window; without a trainer, play as fast as possible.
        is_real_time: Play no faster than people watch.
    """
    headless = ("--ludus-headless",) if is_headless else ()
    real_time = ("--ludus-real-time",) if is_real_time else ()
    return (str(program), *user_args, *headless, *real_time)
