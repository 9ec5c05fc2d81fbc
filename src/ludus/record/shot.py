"""Which frames of a game are filmed: how many, from when, until when."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ludus.play.episodes import EpisodeCounter
from ludus.play.players import MakePlayer
from ludus.play.playing import Play
from ludus.pool.interface import Pool
from ludus.record.film import Film

__all__ = ["Shot"]


@dataclass(frozen=True, kw_only=True)
class Shot:
    """What is taken of a game.

    Attributes:
        film: Gets the frames.
        every: Frames of the game for one of the film.
        num_frames: Longest film, frames.
        num_episodes: End after this many episodes of every policy; None: never.
        num_skipped: Frames of the film left out at the beginning.
        seed: Of worlds.
        window: Width and height of a Godot game's window, pixels; None: the project's.
        has_overlay: Whether a Godot 4 game shows what an agent sees and decides.
    """

    film: Film
    every: int
    num_frames: int
    num_episodes: int | None
    num_skipped: int
    seed: int
    window: tuple[int, int] | None = None
    has_overlay: bool = False

    @property
    def is_full(self) -> bool:
        """Whether the film has all its frames."""
        return self.film.num_frames >= self.num_frames

    def takes(self, frame: int) -> bool:
        """Return whether a frame of the game, counted from 0, belongs to the film."""
        return frame >= self.num_skipped * self.every and frame % self.every == 0

    def play(self, pool: Pool, player: MakePlayer, is_full: Callable[[], bool]) -> dict[str, int]:
        """Play until there are enough episodes, or ``is_full``, which is asked before each step.

        Returns:
            How many episodes have ended, by policy.
        """
        counter = EpisodeCounter(pool.policies, self.num_episodes)
        Play(pool, player(pool), self.seed).run(counter, is_full)
        return dict(counter.num_episodes)
