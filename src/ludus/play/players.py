"""Who decides what agents do: trained policies, policy files, or chance."""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ludus.errors import ConfigError
from ludus.model import ModelRunner, read_model
from ludus.model.frame_stack import FrameStack
from ludus.play.random_actions import RandomActions
from ludus.pool.interface import Pool
from ludus.spec import PolicySpec
from ludus.spec.batch import ActionBatch, Batch, Batches
from ludus.spec.decision import ActionShape, Decision, describe_outputs

if TYPE_CHECKING:
    from ludus.networks.own_network import MakeNetwork
    from ludus.networks.policy import Policy

__all__ = [
    "Act",
    "FilePlayer",
    "MakePlayer",
    "Stochastic",
    "check_trained_for",
    "load_player",
    "random_player",
    "trained_player",
]

log = logging.getLogger(__name__)

Act = Callable[[Batches], Mapping[str, ActionBatch]]
"""From what all agents see to what they do; called once for every step, in order."""

MakePlayer = Callable[[Pool], Act]
"""From a pool that was opened to the way to act in it."""

Stochastic = bool | Collection[str]
"""Which policies draw their actions, as in training: all, none, or those named.

The others take their most probable action.
"""


def random_player(pool: Pool, seed: int) -> Act:
    """Take random legal actions; world *i* draws from a stream seeded with ``seed + i``."""
    num_worlds = pool.num_engines * pool.spec.num_worlds
    return RandomActions(pool.spec, range(seed, seed + num_worlds)).act


def trained_player(
    policies: Mapping[str, Policy], pool: Pool, seed: int, stochastic: Stochastic = False
) -> Act:
    """Act as trained networks do.

    Args:
        policies: One for each policy of the pool.
        pool: Where they act.
        seed: Of drawn actions.
        stochastic: Which policies draw their actions.

    Raises:
        ConfigError: ``stochastic`` names a policy that is none of the pool's.
    """
    import torch

    from ludus.algorithms.learners import policy_seed
    from ludus.networks.policy import Player

    drawing = _drawing(stochastic, pool)
    players: dict[str, Player] = {}
    for name, policy in policies.items():
        generator = None
        if name in drawing:
            generator = torch.Generator(policy.device).manual_seed(policy_seed(seed, name))
        players[name] = Player(policy, pool.num_agents(name), generator)
    return _Team(players)


def load_player(
    paths: Sequence[Path],
    pool: Pool,
    seed: int,
    stochastic: Stochastic = False,
    networks: Mapping[str, MakeNetwork] | None = None,
) -> Act:
    """Act as a run or policy files say.

    Args:
        paths: A run folder, one of its checkpoints, or policy files (protocol/POLICY.md), one for
            each policy of the pool.
        pool: Where they act.
        seed: Of drawn actions.
        stochastic: Which policies draw their actions.
        networks: What the run was trained with in the place of Ludus's networks.

    Raises:
        CheckpointError: The run has no checkpoint, or was trained for something else.
        PolicyFileError: A file cannot be read.
        ConfigError: The files are not the policies of the pool, or ``stochastic`` names a policy
            that is none of the pool's.
    """
    if len(paths) == 1 and paths[0].is_dir():
        from ludus.runs.saved import load_policies

        policies = load_policies(paths[0], pool.policies, networks)
        return trained_player(policies, pool, seed, stochastic)
    drawing = _drawing(stochastic, pool)
    players: dict[str, FilePlayer] = {}
    for i, (name, runner) in enumerate(_read_files(paths, pool).items()):
        generator = np.random.default_rng((seed, i)) if name in drawing else None
        players[name] = FilePlayer(runner, pool.num_agents(name), generator)
    return _Team(players)


class _PolicyPlayer(Protocol):
    """Acts in all slots of one policy."""

    def act(self, batch: Batch) -> ActionBatch: ...

    def describe(self, slot: int) -> Decision: ...


class _Team:
    """The players of all policies as one; :class:`~ludus.play.watched.Describes`."""

    def __init__(self, players: Mapping[str, _PolicyPlayer]) -> None:
        self._players = players

    def __call__(self, batches: Batches) -> Mapping[str, ActionBatch]:
        return {name: player.act(batches[name]) for name, player in self._players.items()}

    def describe(self, policy: str, slot: int) -> Decision:
        return self._players[policy].describe(slot)


def _drawing(stochastic: Stochastic, pool: Pool) -> Collection[str]:
    """Return the policies that draw their actions."""
    if isinstance(stochastic, bool):
        return pool.policies if stochastic else ()
    for name in stochastic:
        if name not in pool.policies:
            raise ConfigError(
                f"--stochastic: there is no policy {name!r}",
                f"the policies are {', '.join(pool.policies)}",
            )
    return stochastic


def _read_files(files: Sequence[Path], pool: Pool) -> dict[str, ModelRunner]:
    """Return what plays each policy of the pool, in the pool's order."""
    models = [read_model(file) for file in files]
    runners = {model.policy: ModelRunner(model) for model in models}
    if runners.keys() != pool.policies.keys():
        raise ConfigError(
            f"the game has the policies {', '.join(pool.policies)}; "
            f"the files hold {', '.join(runners)}",
            hint="name one file for each policy, each with its own --policy",
        )
    for name, spec in pool.policies.items():
        check_trained_for(runners[name], spec)
    return {name: runners[name] for name in pool.policies}


def check_trained_for(runner: ModelRunner, spec: PolicySpec) -> None:
    """Refuse a policy that was trained for something else.

    Raises:
        ConfigError: Its observations or actions are not those of ``spec``.
    """
    if spec.was_unmasked(runner.model.fingerprint):
        log.warning("policy %s was trained without the game's action masks", spec.name)
    elif runner.model.fingerprint != spec.fingerprint():
        raise ConfigError(
            f"the policy {spec.name} was trained for other observations or actions than the game's",
            hint="was the game changed since? train it again",
        )


class FilePlayer:
    """Plays a policy file in a fixed number of slots, and remembers for each.

    It forgets where :class:`ludus.networks.policy.Player` does, so that a file plays as its run.

    Args:
        runner: Of the file.
        num_slots: Rows of every batch.
        generator: Draws actions; None takes the most probable ones.
    """

    def __init__(
        self, runner: ModelRunner, num_slots: int, generator: np.random.Generator | None = None
    ) -> None:
        self._runner = runner
        self._generator = generator
        size, model = runner.memory_size, runner.model
        self._memory = np.zeros((num_slots, size), np.float32) if size else None
        self._was_active = np.zeros(num_slots, np.bool_)
        self._frames = FrameStack(model.observation, model.frames, num_slots)
        self._last: tuple[Batch, NDArray[Any] | None] | None = None

    def act(self, batch: Batch) -> ActionBatch:
        """Return the action of every slot.

        What a slot remembers is forgotten where ``batch`` says that its episode has ended, and
        where the slot was empty before.
        """
        if self._memory is not None:
            goes_on = self._was_active & ~(batch.terminated | batch.truncated)
            self._was_active[...] = batch.active
            self._memory[~goes_on] = 0.0
        batch = self._frames.push_batch(batch)
        self._last = batch, self._memory
        actions, self._memory = self._runner.act(
            batch.observation, batch.action_mask, self._memory, self._generator
        )
        return actions

    def forget(self, rows: NDArray[np.int64]) -> None:
        """Note that episodes begin with the next batch in the slots ``rows``.

        Call it where a reset has begun them: no batch says that the old ones are over.
        """
        self._was_active[rows] = False
        self._frames.forget(rows)

    def describe(self, slot: int) -> Decision:
        """Return how probable the actions of a slot were in the last step."""
        assert self._last is not None
        batch, memory = self._last
        row = slice(slot, slot + 1)
        outputs, _ = self._runner.outputs(
            {name: array[row] for name, array in batch.observation.items()},
            None if memory is None else memory[row],
        )
        model = self._runner.model
        distribution = model.distribution
        shape = ActionShape(
            distribution.log_std, distribution.log_std_range, distribution.is_squashed
        )
        mask = None if batch.action_mask is None else batch.action_mask[slot]
        return describe_outputs(outputs[0], model.spec, shape, mask)
