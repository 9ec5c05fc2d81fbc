"""The players of a run's tournament: its policies as they are now, and their past selves."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from torch import Tensor

from ludus.errors import CheckpointError
from ludus.league.league import past_selves
from ludus.networks.tensors import with_prefix
from ludus.runs.checkpoint import (
    Checkpoint,
    CheckpointStore,
    checkpoint_errors,
    read_checkpoint,
)
from ludus.runs.run_folder import RunFolder
from ludus.runs.saved import find_checkpoint
from ludus.settings.plain import saved_policy
from ludus.settings.policy_config import PolicyConfig

__all__ = ["LeaguePlayer", "LeaguePlayers", "load_players", "subsample"]

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class LeaguePlayer:
    """A policy at one moment of its training.

    Attributes:
        policy: Its name.
        updates: Updates the run had made.
        is_newest: Whether it is the policy as it is now.
        rating: Elo rating from training; None without self-play.
        settings: Of the network.
        tensors: State of the network.
    """

    policy: str
    updates: int
    is_newest: bool
    rating: float | None
    settings: PolicyConfig
    tensors: Mapping[str, Tensor]


LeaguePlayers = Mapping[str, tuple[LeaguePlayer, ...]]
"""By policy, oldest first; the last one is the newest."""


def load_players(run: Path) -> tuple[Path, Checkpoint, LeaguePlayers]:
    """Return the newest policies of a run and their past selves.

    Those are the past selves of its league, or, without self-play, its older checkpoints.

    Args:
        run: A run folder, or one of its checkpoints.

    Returns:
        The newest checkpoint's folder, the checkpoint, and the players.

    Raises:
        CheckpointError: There is no such run, or no checkpoint of it can be loaded.
    """
    store = RunFolder.find(run).checkpoints()
    path, newest = find_checkpoint(run)
    with checkpoint_errors(path):
        past = _of_league(newest) if "league" in newest.run else _of_store(store, newest)
        now = _of_checkpoint(newest, is_newest=True)
        return path, newest, {name: (*past[name], now[name]) for name in now}


def subsample(league_players: Sequence[LeaguePlayer], count: int) -> tuple[LeaguePlayer, ...]:
    """Return at most ``count`` of them, evenly spaced, the oldest and the newest included."""
    if count >= len(league_players):
        return tuple(league_players)
    chosen: list[float] = np.linspace(len(league_players) - 1, 0, count).tolist()
    return tuple(league_players[round(index)] for index in reversed(chosen))


def _of_league(checkpoint: Checkpoint) -> dict[str, list[LeaguePlayer]]:
    pools = past_selves(checkpoint.league, checkpoint.run["league"])
    settings = _settings(checkpoint)
    return {
        name: [
            LeaguePlayer(name, past.number, False, past.rating, settings[name], past.tensors)
            for past in pools[name]
            if past.number < checkpoint.run["updates"]  # otherwise the newest one
        ]
        for name in checkpoint.learners
    }


def _of_store(store: CheckpointStore, newest: Checkpoint) -> dict[str, list[LeaguePlayer]]:
    """Return the policies of the checkpoints before ``newest``."""
    found: dict[str, list[LeaguePlayer]] = {name: [] for name in newest.learners}
    for path in store.paths():
        try:
            checkpoint = read_checkpoint(path)
        except CheckpointError as error:
            log.warning("%s; left out", error.message)
            continue
        is_before = checkpoint.agent_steps < newest.agent_steps
        if is_before and checkpoint.fingerprints == newest.fingerprints:
            for name, league_player in _of_checkpoint(checkpoint, is_newest=False).items():
                found[name].append(league_player)
    return found


def _of_checkpoint(checkpoint: Checkpoint, *, is_newest: bool) -> dict[str, LeaguePlayer]:
    settings = _settings(checkpoint)
    ratings = checkpoint.run.get("league", {}).get("ratings", {})
    return {
        name: LeaguePlayer(
            policy=name,
            updates=int(checkpoint.run["updates"]),
            is_newest=is_newest,
            rating=ratings.get(name),
            settings=settings[name],
            tensors=with_prefix(learner.tensors, "policy."),
        )
        for name, learner in checkpoint.learners.items()
    }


def _settings(checkpoint: Checkpoint) -> dict[str, PolicyConfig]:
    policies = checkpoint.config["policies"]
    return {name: saved_policy(of, f"policies.{name}") for name, of in policies.items()}
