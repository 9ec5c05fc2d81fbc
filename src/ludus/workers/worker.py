"""The worker: plays the engines of one machine and writes down what came of it.

It knows neither pipes nor Ray; those call its methods. Weights come and recordings go as plain
arrays.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import torch

from ludus.algorithms.adam import as_one_vector
from ludus.algorithms.learner import LearnerSettings
from ludus.algorithms.learners import policy_seed
from ludus.algorithms.ppo_recorder import PPORecorder
from ludus.algorithms.recorder import Recorder, unpack_weights
from ludus.errors import LudusError, RunError
from ludus.league.policy_slot import PolicySlot, frozen_seed
from ludus.league.seats import Match, Seats, league_seed
from ludus.networks.policy import Policy
from ludus.play.episodes import EndedEpisodes, EpisodeTracker
from ludus.pool import EnginePool, PoolConfig, open_pool
from ludus.settings.policy_config import PPOConfig
from ludus.settings.train_config import TrainConfig
from ludus.settings.world_parameters import Parameter
from ludus.spec import Spec
from ludus.spec.batch import ActionBatch, Batch, Batches
from ludus.target import check_accepted, parse_target, split_addresses
from ludus.workers.collect import Collector
from ludus.workers.interface import Ended, LeagueOrder, Order, Report

__all__ = ["Worker", "outcome_of"]

log = logging.getLogger(__name__)


class Worker:
    """Plays the engines of one machine.

    Call :meth:`prepare` before :meth:`play`; the methods named after those of a pool need nothing
    but the engines.

    Args:
        config: Settings of the run.
        index: Number of the machine, from 0.
        log_dir: Where engines leave their output; None keeps it with the system's logs.

    Raises:
        TargetError: There is no such target here, or it cannot be trained.
        EngineError: An engine did not start.
    """

    def __init__(self, config: TrainConfig, index: int, log_dir: Path | None = None) -> None:
        self._first_engine = index * config.num_engines
        games = split_addresses(config.target) or [config.target] * (index + 1)
        target = parse_target(games[index], scene=config.scene, godot=config.godot)
        check_accepted("train", target)
        settings = PoolConfig.of(config, log_dir=log_dir, first_engine=self._first_engine)
        self._pool: EnginePool = open_pool(target, settings)
        self._ended: list[Ended] = []
        self._matches: list[tuple[int, int, Match]] = []
        self._updates = -1

    @property
    def spec(self) -> Spec:
        """Spec of one engine."""
        return self._pool.spec

    def prepare(self, config: TrainConfig) -> None:
        """Make what acts and records.

        Args:
            config: Settings with those of every policy.
        """
        torch.set_num_threads(config.torch_threads)
        names = self._pool.policies
        self._book = _Book()
        self._players = {name: _Player(self._make_recorder(name, config)) for name in names}
        self._seats = None
        if config.league.share:
            policies = {name: player.policy for name, player in self._players.items()}
            self._seats = Seats(
                self._book, policies, names, share=config.league.share,
                num_engines=self._pool.num_engines, seed=league_seed(config.seed),
                first_engine=self._first_engine,
            )  # fmt: skip
        self._slots = {
            name: PolicySlot(
                player,
                [names[name].num_agents] * self._pool.num_engines,
                frozen_seed(config.seed, name),
                self._seats,
                first_engine=self._first_engine,
            )
            for name, player in self._players.items()
        }
        self._trackers = {name: EpisodeTracker(self._pool.num_agents(name), 0) for name in names}
        self._collector = Collector(self._pool, self._slots, self._trackers, self._seats)
        self._collector.on_episodes = self._note_episodes
        self._collector.on_matches = self._note_matches

    def _make_recorder(self, name: str, config: TrainConfig) -> Recorder:
        pool, settings = self._pool, config.policies[name]
        about = LearnerSettings(
            engine_rows=[pool.rows(name, engine) for engine in range(pool.num_engines)],
            seed=policy_seed(config.seed or 0, name),
            first_engine=self._first_engine,
        )
        policy = Policy(pool.policies[name], settings)
        # As the learner has them: sums may depend on where in memory a matrix begins.
        as_one_vector(policy.parameters())
        if isinstance(settings, PPOConfig):
            return PPORecorder(policy, settings, about)
        from ludus.algorithms.sac_recorder import SACRecorder

        return SACRecorder(policy, about)

    # --- playing --------------------------------------------------------------------------------

    def play(self, order: Order) -> Report:
        """Do what an order says, and report what came of it."""
        start = time.perf_counter()
        before = {name: tracker.num_steps for name, tracker in self._trackers.items()}
        self._follow(order)
        if order.seed is not None:
            self._collector.reset(order.seed + self._first_engine * self.spec.num_worlds)
        recordings: dict[str, Any] = {}
        if order.num_steps:
            self._collector.collect(lambda: False)
            recordings = {
                name: player.recorder.take()
                for name, player in self._players.items()
                if order.policies[name].mode == "train"
            }
        ended, self._ended = self._ended, []
        matches, self._matches = self._matches, []
        return Report(
            recordings,
            ended,
            {name: of.num_steps - before[name] for name, of in self._trackers.items()},
            time.perf_counter() - start,
            self._pool.num_restarts,
            self._pool.take_metrics(),
            self._pool.take_draws(),
            matches,
            {name: self._collector.playing(name) for name in self._players},
        )

    def _follow(self, order: Order) -> None:
        if order.league is not None:
            kept = {name: self._collector.playing(name) for name in self._players}
            self._book.follow(order.league, kept)
        for name, of in order.policies.items():
            player, slot = self._players[name], self._slots[name]
            if of.weights is not None:
                unpack_weights(player.policy, of.weights)
            player.recorder.follow(of.number, of.is_exploring)
            slot.set_mode(of.mode)
            if order.updates != self._updates or order.seed is not None:
                slot.advance(order.updates)
            player.num_steps_left = order.num_steps
        if self._seats is not None and (order.updates != self._updates or order.seed is not None):
            self._seats.advance(order.updates)
        self._updates = order.updates

    def _note_episodes(self, policy: str, _: int, ended: EndedEpisodes) -> None:
        step, engine = self._collector.place
        self._ended.append(Ended(step, engine, policy, ended))

    def _note_matches(self, matches: list[Match]) -> None:
        step, engine = self._collector.place
        self._matches += [(step, engine, match) for match in matches]

    # --- the pool -------------------------------------------------------------------------------

    def ignore_masks(self, policy: str) -> None:
        """Leave the action masks of ``policy`` out; before :meth:`prepare`."""
        self._pool.ignore_masks(policy)

    def reset_pool(self, seed: int | None) -> Batches:
        """Begin new episodes everywhere; ``seed`` is that of the run's first world."""
        first = self._first_engine * self.spec.num_worlds
        return self._pool.reset(None if seed is None else seed + first)

    def step(self, actions: Mapping[str, ActionBatch]) -> Batches:
        """Step all engines; returns copies."""
        return self._pool.step(actions)

    def randomise(self, parameters: Mapping[str, Parameter]) -> None:
        """Draw parameters for worlds."""
        self._pool.randomise(parameters)

    def tell(self, status: Mapping[str, Any] | None) -> list[dict[str, Any]]:
        """Tell the games how training goes, if anything; fetch what they ask of the trainer."""
        if status is not None:
            self._pool.show_status(status)
        return self._pool.take_requests()

    def close(self) -> None:
        """End all engines; may be called twice."""
        self._pool.close()


def outcome_of(call: Callable[[], Any]) -> tuple[str, Any]:
    """Do what a trainer asks for; return ``("result", value)`` or ``("error", error)``."""
    try:
        return "result", call()
    except LudusError as error:
        return "error", error
    except Exception as error:
        log.exception("a defect in a worker")
        said = f"{type(error).__name__}: {error}"
        return "error", RunError(f"a worker failed: {said}", "train.log has the traceback")


class _Book:
    """What a worker knows of the league; a :class:`~ludus.league.seats.Book`."""

    def __init__(self) -> None:
        self.learning: frozenset[str] = frozenset()
        self.opponents: Mapping[str, Sequence[int]] = {}
        self._past: dict[tuple[str, int], dict[str, torch.Tensor]] = {}

    def tensors(self, policy: str, number: int) -> Mapping[str, torch.Tensor]:
        return self._past[policy, number]

    def follow(self, order: LeagueOrder, kept: Mapping[str, set[int]]) -> None:
        """Go on with other opponents; past selves that are ``kept`` still play."""
        self.learning, self.opponents = order.learning, order.opponents
        self._past = {key: of for key, of in self._past.items() if key[1] in kept[key[0]]}
        for name, numbers in order.past.items():
            for number, arrays in numbers.items():
                self._past[name, number] = {
                    key: torch.from_numpy(array.copy())  # pyright: ignore[reportUnknownMemberType]
                    for key, array in arrays.items()
                }


class _Player:
    """A policy whose learner is elsewhere; a :class:`~ludus.algorithms.learner.Learner`.

    Attributes:
        recorder: What acts.
        num_steps_left: Steps of every engine that are asked for.
    """

    def __init__(self, recorder: Recorder) -> None:
        self.recorder = recorder
        self.num_steps_left = 0

    @property
    def policy(self) -> Policy:
        return self.recorder.policy

    def begin(self, engine: int, batch: Batch) -> None:
        self.recorder.begin(engine, batch)

    def act(self, engine: int) -> ActionBatch:
        return self.recorder.act(engine)

    def record(self, engine: int, batch: Batch) -> None:
        self.recorder.record(engine, batch)

    def learn_while_stepping(self) -> None:
        """Do nothing."""
