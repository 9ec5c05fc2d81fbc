"""Who plays in a film: a trained run, policy files, or chance."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ludus.errors import ConfigError
from ludus.model import ModelRunner, read_model
from ludus.play.random_actions import RandomActions
from ludus.pool.interface import Pool
from ludus.spec.batch import ActionBatch, Batch, Batches

__all__ = ["Act", "file_player", "find_run", "random_player", "run_player"]

Act = Callable[[int, Batches], Mapping[str, ActionBatch]]
"""From the number of the step and what all agents see to what they do."""

SCRIPT_STEPS = 1000


def find_run(path: Path) -> Path | None:
    """Return ``path`` if it is a run folder or one of its checkpoints, else None."""
    if not path.is_dir() or (path / "project.godot").is_file():
        return None
    homes = (path, path.resolve().parent.parent)
    return path if any((home / "config.json").is_file() for home in homes) else None


def random_player(pool: Pool, seed: int) -> Act:
    """Take random legal actions."""
    seeds = [seed + world for world in range(pool.spec.num_worlds)]
    return RandomActions(pool.spec, seeds, SCRIPT_STEPS).at


def run_player(pool: Pool, run: Path, seed: int, *, is_stochastic: bool) -> Act:
    """Act as the agents of a run would.

    Raises:
        CheckpointError: The run has no checkpoint, or was trained for something else.
    """
    from ludus.networks.policy import Player
    from ludus.play.evaluation import seeded_generator
    from ludus.runs.saved import load_policies

    players = {
        name: Player(
            policy, pool.num_agents(name), seeded_generator(policy, seed) if is_stochastic else None
        )
        for name, policy in load_policies(run, pool.policies).items()
    }
    return lambda _, batches: {name: player.act(batches[name]) for name, player in players.items()}


def file_player(pool: Pool, files: Sequence[Path], seed: int, *, is_stochastic: bool) -> Act:
    """Act as policy files (protocol/POLICY.md) say, one for each policy of the game.

    Raises:
        PolicyFileError: A file cannot be read.
        ConfigError: They are not the policies of the game.
    """
    models = [read_model(file) for file in files]
    runners = {model.policy: ModelRunner(model) for model in models}
    if runners.keys() != pool.policies.keys():
        raise ConfigError(
            f"the game has the policies {', '.join(pool.policies)}; "
            f"the files hold {', '.join(runners)}",
            hint="name one file for each policy, each with its own --policy",
        )
    for name, spec in pool.policies.items():
        if runners[name].model.fingerprint != spec.fingerprint():
            raise ConfigError(
                f"the policy {name} was trained for other observations or actions than the game's",
                hint="was the game changed since? train it again",
            )
    players = {
        name: _FilePlayer(
            runners[name], np.random.default_rng((seed, i)) if is_stochastic else None
        )
        for i, name in enumerate(pool.policies)
    }
    return lambda _, batches: {name: player.act(batches[name]) for name, player in players.items()}


class _FilePlayer:
    """Plays a policy file, and forgets where an episode has ended."""

    def __init__(self, runner: ModelRunner, generator: np.random.Generator | None) -> None:
        self._runner = runner
        self._generator = generator
        self._memory: NDArray[Any] | None = None

    def act(self, batch: Batch) -> ActionBatch:
        if self._memory is not None:
            self._memory[batch.final_index] = 0.0
        actions, self._memory = self._runner.act(
            batch.observation, batch.action_mask, self._memory, self._generator
        )
        return actions
