"""Evaluation: complete episodes, chosen before they begin."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ludus.errors import RunError
from ludus.play.episodes import EndedEpisodes
from ludus.play.players import Act
from ludus.play.playing import Play
from ludus.play.quota import Quota
from ludus.pool.interface import Pool

__all__ = ["Evaluation", "evaluate", "play_round"]

MAX_STEPS = 100_000
"""Steps after which an evaluation usually gives up waiting for episodes to end."""


@dataclass(frozen=True)
class Evaluation:
    """Returns of one policy over complete episodes.

    Attributes:
        num_episodes: How many.
        mean_return: Mean of the undiscounted returns.
        std_return: Their standard deviation.
        min_return: The lowest.
        max_return: The highest.
        mean_length: Mean of the agent steps.
        returns: All of them.
        lengths: All of them.
    """

    num_episodes: int
    mean_return: float
    std_return: float
    min_return: float
    max_return: float
    mean_length: float
    returns: tuple[float, ...]
    lengths: tuple[int, ...]

    @classmethod
    def of(cls, returns: list[float], lengths: list[int]) -> Evaluation:
        """Summarise episodes; there is at least one."""
        values = np.asarray(returns)
        return cls(
            num_episodes=len(returns),
            mean_return=float(values.mean()),
            std_return=float(values.std()),
            min_return=float(values.min()),
            max_return=float(values.max()),
            mean_length=float(np.mean(lengths)),
            returns=tuple(returns),
            lengths=tuple(lengths),
        )

    def share_reaching(self, goal_return: float) -> float:
        """Return the share of episodes, 0 to 1, whose return is at least ``goal_return``."""
        return sum(each >= goal_return for each in self.returns) / self.num_episodes


class _Tally:
    """Returns and lengths of the episodes that a quota takes."""

    def __init__(self, quota: Quota) -> None:
        self.quota = quota
        self.returns: list[float] = []
        self.lengths: list[int] = []

    def add(self, ended: EndedEpisodes) -> None:
        """Count those of the episodes that the quota takes."""
        taken = self.quota.take(ended.slots)
        self.returns += ended.returns[taken].tolist()
        self.lengths += ended.lengths[taken].tolist()


def evaluate(
    act: Act, pool: Pool, episodes: int = 20, *, seed: int = 0, max_steps: int = MAX_STEPS
) -> dict[str, Evaluation]:
    """Play ``episodes`` episodes of every policy and return how they went.

    The episodes are spread evenly over the slots that are active after the reset, and each slot's
    first ones count. Of a policy whose agents all come later, those that end first count. Nothing
    is learnt meanwhile; observation statistics stay as they are.

    Args:
        act: Decides what agents do; see :mod:`ludus.play.players`.
        pool: Reset before; in the middle of episodes afterwards.
        episodes: Complete episodes of each policy.
        seed: Seed of worlds.
        max_steps: Steps of the pool after which it gives up waiting for episodes to end.

    Raises:
        RunError: Some episodes did not end within ``max_steps`` steps.
    """
    play = Play(pool, act, seed)
    tallies = {name: _Tally(Quota(batch, episodes)) for name, batch in play.batches.items()}
    for num_steps, _ in enumerate(_fill(tallies, play)):
        if num_steps == max_steps:
            break
    for name, tally in tallies.items():
        if not tally.quota.is_met:
            raise RunError(
                f"policy {name}: {len(tally.returns)} of {episodes} episodes ended "
                f"within {max_steps} steps",
                "set max_episode_steps, in the game or with --max-episode-steps",
            )
    return {name: Evaluation.of(tally.returns, tally.lengths) for name, tally in tallies.items()}


def play_round(
    act: Act, pool: Pool, seed: int, is_stopping: Callable[[], bool]
) -> dict[str, Evaluation] | None:
    """Play until every slot that began has ended its first episode; otherwise as :func:`evaluate`.

    Args:
        act: Decides what agents do.
        pool: Reset before; in the middle of episodes afterwards.
        seed: Of the worlds.
        is_stopping: Asked before each step.

    Returns:
        How the episodes went, by policy; None if ``is_stopping`` said so first.
    """
    play = Play(pool, act, seed)
    tallies = {name: _Tally(Quota(batch)) for name, batch in play.batches.items()}
    for _ in _fill(tallies, play):
        if is_stopping():
            return None
    return {
        name: Evaluation.of(tally.returns, tally.lengths)
        for name, tally in tallies.items()
        if tally.returns
    }


def _fill(tallies: Mapping[str, _Tally], play: Play) -> Iterator[None]:
    """Play until all quotas are met; yield before each step."""
    while not all(tally.quota.is_met for tally in tallies.values()):
        yield
        for name, ended in play.step().items():
            tallies[name].add(ended)
