"""Film a game that gives pictures of its worlds when asked: one made with Bevy."""

from __future__ import annotations

import base64
import binascii
import contextlib
import itertools
from fractions import Fraction
from typing import Any, cast

import numpy as np

from ludus.errors import GameError, TargetError
from ludus.play.players import MakePlayer
from ludus.pool import EnginePool
from ludus.pool.interface import Pool
from ludus.record.film import Frame
from ludus.record.shot import Shot

__all__ = ["film_pictures", "picture_rate", "take_picture"]

METHOD = "picture"
"""What is called on a world; ``LudusFilmCamera`` answers it."""


def picture_rate(pool: Pool) -> Fraction:
    """Return how many pictures a second of game time has: one for each step."""
    ticks = Fraction(pool.spec.tick_rate).limit_denominator(1000)
    return ticks / pool.spec.ticks_per_step


def film_pictures(pool: EnginePool, player: MakePlayer, shot: Shot) -> dict[str, int]:
    """Film the first world: its first state, and the state after each step.

    Args:
        pool: Of one engine.
        player: From the pool to the way to act in it.
        shot: What is taken.

    Returns:
        How many episodes of each policy have ended.

    Raises:
        TargetError: The game gives no pictures.
        EngineError: The game failed.
        RunError: The film could not be written.
    """
    steps = itertools.count()

    def shoot() -> bool:
        if shot.takes(next(steps)):
            shot.film.add(take_picture(pool))
        return shot.is_full

    return shot.play(pool, player, shoot)


def take_picture(pool: EnginePool, world: int = 0) -> Frame:
    """Take a picture of a world: what its film cameras see, beside each other.

    Raises:
        TargetError: The game gives no pictures.
        EngineError: The game failed.
    """
    try:
        engine, local = divmod(world, pool.spec.num_worlds)
        answer = pool.sessions[engine].call({"world": local}, METHOD)
    except GameError as error:
        raise TargetError(
            f"the game gives no pictures: {error.message}",
            hint="a Bevy game needs its feature camera and a LudusFilmCamera in each world "
            "(docs/cameras.md); Godot 3 gives none; ludus record films the project of a Godot game",
        ) from error
    pictures = cast("list[Any]", answer) if isinstance(answer, list) else [answer]
    frames = [_decode(picture) for picture in pictures]
    height = min(frame.shape[0] for frame in frames)
    return np.concatenate([frame[:height] for frame in frames], axis=1)


def _decode(picture: Any) -> Frame:
    with contextlib.suppress(KeyError, TypeError, ValueError, binascii.Error):
        height, width = picture["height"], picture["width"]
        pixels = np.frombuffer(base64.b64decode(picture["rgb"], validate=True), np.uint8)
        return pixels.reshape(height, width, 3)
    raise TargetError(
        f"the game's method {METHOD} returned no picture, but {str(picture)[:80]}",
        hint="it must return objects with width, height and rgb, base64 of 3 bytes a pixel",
    )
