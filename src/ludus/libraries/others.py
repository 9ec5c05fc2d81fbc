"""What the agents do whose policies an environment does not stand for."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ludus.errors import ArgumentError, UsageError
from ludus.model import ModelRunner, read_model
from ludus.play.players import FilePlayer, check_trained_for
from ludus.play.random_actions import RandomActions
from ludus.pool import EnginePool
from ludus.spec import PolicySpec
from ludus.spec.batch import ActionBatch, Batch, Batches
from ludus.spec.spaces import observation_of, to_action_batch

__all__ = ["OtherPolicies", "Player"]

Player = str | Path | Callable[[Any], Any]
"""A policy file (``.ludus.json``), or a function from observations to actions.

The function gets and returns what a vector environment of that policy has: a batch of its
observation space, a batch of its action space.
"""


class _Acts(Protocol):
    def act(self, batch: Batch) -> ActionBatch: ...

    def forget(self, rows: NDArray[np.int64]) -> None: ...


class OtherPolicies:
    """Acts for all policies but one: as given, else at random.

    Args:
        pool: The game.
        own: The policy that somebody else acts for.
        players: By policy; the rest is random.

    Raises:
        UsageError: ``players`` names a policy that the game does not have, or ``own``.
        PolicyFileError: A file cannot be read.
        ConfigError: A file was trained for something else.
    """

    def __init__(self, pool: EnginePool, own: str, players: Mapping[str, Player]) -> None:
        others = {name: policy for name, policy in pool.policies.items() if name != own}
        for name in players:
            if name not in others:
                raise UsageError(
                    f"others names {name!r}, but the other policies are {list(others) or 'none'}"
                )
        self._players = {
            name: _player(player, others[name], pool.num_agents(name))
            for name, player in players.items()
        }
        random = [policy for name, policy in others.items() if name not in players]
        self._spec = replace(pool.spec, policies=tuple(random))
        self._num_worlds = pool.num_worlds
        self._random: RandomActions | None = None
        self._batches: Batches = {}

    def begin(
        self, batches: Batches, seeds: Sequence[int | None], is_reset: NDArray[np.bool_]
    ) -> None:
        """Take the batches of a reset; random streams restart if all worlds were seeded.

        Args:
            batches: What all agents see now.
            seeds: By world.
            is_reset: ``bool[num_worlds]``, where an episode begins with ``batches``.
        """
        for name, batch in self._batches.items():
            # Ends that only this batch tells of; no player has seen it, and now none will.
            self._forget(name, batch.terminated | batch.truncated)
        self.observe(batches, is_reset)
        if not self._spec.policies:
            return
        known = [seed for seed in seeds if seed is not None]
        if len(known) == self._num_worlds:
            self._random = RandomActions(self._spec, known)
        elif self._random is None:
            first = secrets.randbits(48)
            self._random = RandomActions(self._spec, range(first, first + self._num_worlds))

    def act(self) -> dict[str, ActionBatch]:
        """Return the actions of the other policies in the next step."""
        actions = self._random.act(self._batches) if self._random is not None else {}
        for name, player in self._players.items():
            actions[name] = player.act(self._batches[name])
        return actions

    def observe(self, batches: Batches, has_begun: NDArray[np.bool_]) -> None:
        """Take the batches of a step.

        Args:
            batches: What all agents see now.
            has_begun: ``bool[num_worlds]``, where an episode begins with ``batches`` although
                they do not say that the last one has ended.
        """
        if has_begun.any():
            for name, batch in batches.items():
                self._forget(name, np.repeat(has_begun, batch.num_agents // self._num_worlds))
        self._batches = batches

    def _forget(self, name: str, slots: NDArray[np.bool_]) -> None:
        if name in self._players:
            self._players[name].forget(np.flatnonzero(slots))


class _Function:
    """Acts as a user's function does."""

    def __init__(self, function: Callable[[Any], Any], policy: PolicySpec, num: int) -> None:
        self._function, self._policy, self._num_agents = function, policy, num

    def act(self, batch: Batch) -> ActionBatch:
        actions = self._function(observation_of(self._policy, batch.observation))
        return to_action_batch(self._policy, actions, self._num_agents)

    def forget(self, rows: NDArray[np.int64]) -> None:
        """Do nothing: a function is told only what its agents observe."""


def _player(player: object, policy: PolicySpec, num_agents: int) -> _Acts:
    if callable(player):
        return _Function(player, policy, num_agents)
    if not isinstance(player, str | Path):
        raise ArgumentError(
            f"others[{policy.name!r}] is a {type(player).__name__}, expected the path of a policy "
            "file (.ludus.json) or a function from observations to actions"
        )
    runner = ModelRunner(read_model(player))
    check_trained_for(runner, policy)
    return FilePlayer(runner, num_agents)
