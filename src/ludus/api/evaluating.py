"""``ludus.evaluate``: complete episodes of a run, of policy files or of chance, in any game."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch

from ludus.arguments import check_arguments
from ludus.errors import ConfigError
from ludus.libraries.seeds import check_seed
from ludus.networks.own_network import MakeNetwork
from ludus.play.evaluation import Evaluation
from ludus.play.evaluation import evaluate as evaluate_in
from ludus.play.players import Stochastic, load_player, random_player
from ludus.pool import Pool
from ludus.runs.saved import trained_config
from ludus.settings.merging import PYTHON
from ludus.settings.plain import merge_settings, plain_settings
from ludus.settings.train_config import TrainConfig
from ludus.target import PolicyFile, find_run, parse_target
from ludus.training.loop import open_training_pool, require_pool

__all__ = ["RANDOM", "evaluate"]

RANDOM = "random"
"""In the place of a policy: random actions."""

Paths = str | Path | Sequence[str | Path]


@check_arguments
def evaluate(
    target: str | Path,
    policy: Paths | None = None,
    *,
    episodes: int = 20,
    seed: int = 0,
    stochastic: Stochastic = False,
    networks: Mapping[str, MakeNetwork] | None = None,
    pool: Pool | None = None,
    **settings: Any,
) -> dict[str, Evaluation]:
    """Play complete episodes and return how they went, by policy.

    >>> ludus.evaluate("runs/cartpole-…")["cart"].mean_return       # doctest: +SKIP
    >>> ludus.evaluate("cartpole", "random", episodes=100)          # doctest: +SKIP
    >>> ludus.evaluate("cartpole", "cart.ludus.json")               # doctest: +SKIP

    Args:
        target: A run folder or checkpoint, whose game is played; or a game (docs/targets.md).
        policy: What plays: a run folder or checkpoint, policy files (``.ludus.json``), one for each
            policy of the game, or ``"random"``. None is the run that ``target`` names.
        episodes: Complete episodes of each policy.
        seed: Seed of worlds and samples.
        stochastic: Draw actions as in training instead of taking the most probable ones; with
            names, only those policies do.
        networks: What a run was trained with in the place of Ludus's networks.
        pool: Play in these engines and leave them open; None opens the game.
        settings: Fields of :class:`ludus.TrainConfig` such as ``num_worlds``; what is left out is
            as in training. One engine is opened unless ``num_engines`` is given.

    Raises:
        ArgumentError: An argument has the wrong type.
        ConfigError: A setting is unknown or does not fit, or there is nothing that could play.
        TargetError: There is no such game.
        CheckpointError: There is no such run, or it was trained for something else.
        PolicyFileError: A policy file cannot be read.
        RunError: Episodes do not end.
        EngineError: The game failed.
    """
    if episodes < 1:
        raise ConfigError(f"episodes must be at least 1, not {episodes}")
    check_seed(seed)
    require_pool(pool)
    is_run = find_run(Path(target)) is not None
    if policy is None and not is_run:
        if isinstance(parse_target(target), PolicyFile):  # what does not exist is told first
            raise ConfigError(
                f"{target} is a policy, and no game was named that it plays",
                hint="ludus evaluate GAME --policy FILE; in Python ludus.evaluate(GAME, FILE)",
            )
        raise ConfigError(
            f"{target} is a game, and nothing was named that plays it",
            "name what plays: --policy with a run folder or a .ludus.json file, or --random; "
            'in Python the second argument, a path or "random"',
        )
    paths = [Path(target)] if policy is None else _paths(policy)
    config = _config(target, is_run, paths, {"num_engines": 1, **settings})
    torch.set_num_threads(config.torch_threads)
    with contextlib.ExitStack() as stack:
        source = pool or stack.enter_context(open_training_pool(config, command="evaluate"))
        if policy == RANDOM:
            act = random_player(source, seed)
        else:
            act = load_player(paths, source, seed, stochastic, networks)
        return evaluate_in(act, source, episodes, seed=seed)


def _paths(policy: Paths) -> list[Path]:
    return [Path(policy)] if isinstance(policy, str | Path) else [Path(path) for path in policy]


def _config(
    target: str | Path, is_run: bool, players: Sequence[Path], settings: Mapping[str, Any]
) -> TrainConfig:
    """Return what to play in: what the run was trained in, or a game as it says itself."""
    if is_run:
        config = trained_config(Path(target))
    else:
        config = TrainConfig(str(target))
        if len(players) == 1 and find_run(players[0]) is not None:
            run = trained_config(players[0], uses=("godot",))
            config = replace(
                config,
                ticks_per_step=run.ticks_per_step,
                max_episode_steps=run.max_episode_steps,
                godot=run.godot,
            )
    return merge_settings(config, plain_settings(settings), PYTHON)
