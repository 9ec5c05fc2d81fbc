"""The training loop: collect, update, measure, save, until it is time to stop."""

from __future__ import annotations

import contextlib
import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Protocol, cast

import numpy as np
from torch import Tensor

from ludus.algorithms.learner import Learner
from ludus.algorithms.ppo import PPO
from ludus.algorithms.sac import SAC
from ludus.curriculum.lessons import Lessons
from ludus.errors import DivergenceError, RunError
from ludus.league.league import League
from ludus.league.policy_slot import PolicySlot, frozen_seed
from ludus.league.seats import Seats, league_seed
from ludus.networks.policy import Policy
from ludus.play.episodes import EpisodeTracker
from ludus.play.evaluation import Evaluation
from ludus.pool.interface import Pool
from ludus.runs.checkpoint import Checkpoint, write_checkpoint
from ludus.runs.metrics import MetricsLog
from ludus.runs.random_state import random_state, restore_random_state
from ludus.runs.run_folder import RunFolder
from ludus.runs.run_list import StopReason
from ludus.runs.tracking import open_trackers
from ludus.settings.plain import to_plain
from ludus.settings.policy_config import Mode
from ludus.settings.train_config import TrainConfig
from ludus.spec import PolicySpec
from ludus.training.diagnosis import Diagnosis
from ludus.training.modes import ModeSchedule
from ludus.training.progress import Progress, Reporter
from ludus.workers.collect import Collector, CollectTimes, OnEpisodes
from ludus.workers.interface import Workers
from ludus.workers.remote_pool import RemotePool
from ludus.workers.remote_workers import RemoteWorkers

__all__ = ["Trainer", "TrainerCallback"]

log = logging.getLogger(__name__)

SPEED_MEMORY = 0.9
"""Weight of the past in the speed that progress shows."""


class TrainerCallback(Protocol):
    """What a trainer calls between steps."""

    def is_due(self) -> bool:
        """Return whether :meth:`call` is to be called before the next step.

        The trainer asks before every step, so this must be quick. Nothing collected is lost.
        """
        ...

    def call(self) -> bool:
        """Report and handle requests; called when :meth:`is_due`, at the start, after every update.

        Returns:
            Whether training has to end.
        """
        ...


class Trainer:
    """All that changes while a run goes on.

    Call :meth:`resume` or not, then :meth:`run`, which may be called again to go on.

    Attributes:
        config: Settings in effect.
        updates: Updates so far.
        wall_s: Seconds of training so far, over all resumptions.
        progress: As of the last update; None before the first one.
    """

    def __init__(
        self, config: TrainConfig, pool: Pool, learners: Mapping[str, Learner], folder: RunFolder
    ) -> None:
        self.config = config
        self.updates = 0
        self.wall_s = 0.0
        self.progress: Progress | None = None
        self._pool = pool
        self._folder = folder
        self._learners = learners
        self._trackers = {
            name: EpisodeTracker(pool.num_agents(name), config.return_window) for name in learners
        }
        policies = {name: learner.policy for name, learner in learners.items()}
        self._league = make_league(config, pool, policies)
        self._workers, self._slots = self._make_workers()
        self._schedule = ModeSchedule(config)
        self._lessons = Lessons(config.curriculum, config.randomise)
        self._teach()
        self._diagnosis = Diagnosis(self.specs)
        self._store = folder.checkpoints(config.keep_checkpoints)
        self._steps_per_s = 0.0
        self._saved_at_s, self._saved_at_update = 0.0, 0
        self._has_begun = False

    def _make_workers(self) -> tuple[Workers, dict[str, PolicySlot]]:
        pool, league, seed = self._pool, self._league, self.config.seed
        is_here = not isinstance(pool, RemotePool)
        seats = None
        if league is not None and is_here:
            policies = {name: learner.policy for name, learner in self._learners.items()}
            seats = Seats(
                league, policies, pool.policies, share=self.config.league.share,
                num_engines=pool.num_engines, seed=league_seed(seed),
            )  # fmt: skip
        slots = {
            name: PolicySlot(
                learner, [learner.policy.spec.num_agents] * pool.num_engines,
                frozen_seed(seed, name), seats,
            )
            for name, learner in self._learners.items()
        }  # fmt: skip
        if is_here:
            workers = Collector(pool, slots, self._trackers, seats)
            workers.on_matches = None if league is None else league.rate
            return workers, slots
        pool.prepare(self.config)
        return RemoteWorkers(pool, self._learners, slots, self._trackers, league), slots

    @property
    def specs(self) -> Mapping[str, PolicySpec]:
        """What each policy observes and does."""
        return self._pool.policies

    @property
    def agent_steps(self) -> int:
        """Agent steps so far, of all policies."""
        return self._workers.num_steps

    def mean_returns(self) -> dict[str, float]:
        """Return the mean of the last episodes of each policy that had any."""
        return {
            name: float(np.mean(tracker.returns))
            for name, tracker in self._trackers.items()
            if tracker.returns
        }

    def status(self) -> dict[str, Any]:
        """Return what games are told of the run (PROTOCOL.md §8)."""
        returns = self.mean_returns()
        policies = {
            name: {"mode": slot.mode, "mean_return": returns.get(name)}
            for name, slot in self._slots.items()
        }
        return {"agent_steps": self.agent_steps, "updates": self.updates, "policies": policies}

    def resume(self, checkpoint: Checkpoint) -> None:
        """Take everything from a checkpoint but the worlds, which begin new episodes.

        Raises:
            CheckpointError: It does not fit the networks.
        """
        for name, learner in self._learners.items():
            learner.load_state(checkpoint.learners[name])
            self._trackers[name].load_state(checkpoint.run["episodes"][name])
            self._slots[name].load_state(checkpoint.run["seats"][name])
        if self._league is not None and "league" in checkpoint.run:
            self._league.load_state(checkpoint.league, checkpoint.run["league"])
        if "lessons" in checkpoint.run:  # older checkpoints have none
            self._lessons.load_state(checkpoint.run["lessons"])
            self._teach()
        if "diagnosis" in checkpoint.run:  # older checkpoints have none
            self._diagnosis.load_state(checkpoint.run["diagnosis"])
        before = checkpoint.config["policies"]
        for name, settings in self.config.policies.items():
            if settings.mode != before[name]["mode"]:  # otherwise the mode that it was in stays
                self.set_mode(name, settings.mode)
        self._note_learning()
        self.updates = int(checkpoint.run["updates"])
        self.wall_s = float(checkpoint.run["wall_s"])
        self._saved_at_s, self._saved_at_update = self.wall_s, self.updates
        restore_random_state(checkpoint.run["random"])

    def begin(self) -> None:
        """Put every policy into its first mode; :meth:`run` does it otherwise."""
        if self.updates == 0 and not self._has_begun:
            self._advance()
        self._has_begun = True

    def run(
        self,
        is_stopping: Callable[[], bool],
        reporter: Reporter,
        callback: TrainerCallback,
        is_confirmed: Callable[[], bool] = lambda: True,
    ) -> StopReason:
        """Train until a limit of the config is reached or a stop is requested.

        The last state is saved on every way out but a second Ctrl-C or SIGTERM, and but
        divergence, which is saved elsewhere.

        Args:
            is_stopping: Asked before each step.
            reporter: Shows progress.
            callback: Handles requests.
            is_confirmed: Asked when the returns of training have reached ``target_return``, with
                worlds that it may play in; False goes on for ``return_window`` more episodes.

        Raises:
            DivergenceError: A loss became NaN or infinite.
            EngineError: An engine failed for good.
            RunError: A file cannot be written.
            Exception: What a callback of a script raised.
        """
        self.begin()
        self.save()
        trackers = open_trackers(self.config, self._folder.path)
        metrics = MetricsLog(self._folder.path, self.agent_steps, trackers)
        try:
            self._pool.take_metrics()  # of what was played before
            if callback.call():
                reason = "stopped"
            else:
                self._reset()
                reason = self._loop(is_stopping, reporter, callback, metrics, is_confirmed)
            self.save()
        except DivergenceError as error:
            raise self._save_diverged(error) from None
        except Exception:  # of an engine, a script's callback, the disk, or a defect
            self._try_to_save()
            raise
        finally:
            with contextlib.suppress(RunError):  # each line was written, or reported, at once
                metrics.close()
        return reason

    def _loop(
        self,
        is_stopping: Callable[[], bool],
        reporter: Reporter,
        callback: TrainerCallback,
        metrics: MetricsLog,
        is_confirmed: Callable[[], bool],
    ) -> StopReason:
        while (reason := self._reached_limit(is_confirmed)) is None:
            start, steps_before = time.perf_counter(), self.agent_steps
            times = replace(self._workers.times)
            interruption = self._collect(is_stopping, callback)
            update_start = time.perf_counter()
            losses = self._update() if interruption is None else {}
            end = time.perf_counter()
            self.wall_s += end - start
            if interruption is not None:
                return interruption
            shares = self._shares(times, end - update_start, end - start)
            speed = (self.agent_steps - steps_before) / (end - start)
            policies = {name: self._policy_metrics(name, losses) for name in self._learners}
            self._advance()  # at once, so that what is saved after an error has advanced, too
            run_metrics = {
                "agent_steps": self.agent_steps,
                "updates": self.updates,
                "wall_s": self.wall_s,
                "steps_per_s": speed,
                **shares,
                "restarts": self._pool.num_restarts,
                "lesson": self._lessons.index + 1,
            }
            game = {name: of.to_json() for name, of in self._pool.take_metrics().items()}
            metrics.write(run_metrics, policies, game, self._take_parameters())
            self.progress = self._progress(speed, policies)
            reporter.updated(self.progress)
            self._diagnosis.check(policies, self.agent_steps)
            is_resetting = self._advance_lesson()
            if self._is_time_to_save():
                self.save()
                is_resetting |= self.config.exact_resume
            if is_resetting:
                self._reset()
            self._keep()
            if callback.call():
                return "stopped"
        return reason

    def _collect(
        self, is_stopping: Callable[[], bool], callback: TrainerCallback
    ) -> StopReason | None:
        """Step until a learner is due to update; return why that was not reached, or None."""

        def is_pausing() -> bool:
            return is_stopping() or callback.is_due()

        while not self._workers.collect(is_pausing):
            if is_stopping():
                return "interrupted"
            if callback.call():
                return "stopped"
        return None

    def _reset(self) -> None:
        """Begin new episodes, in worlds that depend on the seed and the update only."""
        seed = self.config.seed or 0
        if self.updates:
            words = np.random.SeedSequence((seed, self.updates)).generate_state(1, np.uint64)
            seed = int(words[0] >> np.uint64(2))
        self._workers.advance(self.updates)
        self._workers.reset(seed)

    def _update(self) -> dict[str, dict[str, float]]:
        progress = min(1.0, self.agent_steps / self.config.total_steps)
        losses = {
            name: self._learners[name].update(progress)
            for name, slot in self._slots.items()
            if slot.num_steps_left == 0
        }
        self.updates += 1
        return losses

    # --- who learns -----------------------------------------------------------------------------

    def _advance(self) -> None:
        """Begin what is due after an update: a phase of the schedule, other opponents."""
        if self._schedule.is_change(self.updates):
            for name, mode in self._schedule.at(self.updates).items():
                self.set_mode(name, mode)
        if self._league is not None:
            playing = {name: self._workers.playing(name) for name in self._slots}
            self._league.advance(self.updates, playing)
        self._workers.advance(self.updates)

    def _advance_lesson(self) -> bool:
        """Begin the next lesson if it is time; return whether it has begun."""
        window = self.config.return_window
        returns = [
            float(np.mean(tracker.returns)) if len(tracker.returns) == window else None
            for tracker in self._trackers.values()
        ]
        if not self._lessons.advance(self.agent_steps, returns):
            return False
        self._forget_returns()  # those of different lessons do not compare
        self._teach()
        return True

    def _forget_returns(self) -> None:
        for tracker in self._trackers.values():
            tracker.returns.clear()
            tracker.lengths.clear()

    def finish_lessons(self) -> None:
        """Give the worlds the parameters of the last lesson, from the next reset on."""
        self._lessons.finish()
        self._teach()

    def compare(self, evaluation: Mapping[str, Evaluation]) -> None:
        """Warn if the evaluation at the end is far below training."""
        returns = {name: list(tracker.returns) for name, tracker in self._trackers.items()}
        self._diagnosis.compare(evaluation, returns)

    def _teach(self) -> None:
        """Give the worlds the parameters of the lesson, from the next reset on."""
        if self._lessons.has_parameters:
            self._pool.randomise(self._lessons.parameters)

    def _take_parameters(self) -> dict[str, float]:
        """Return the mean of each number that was drawn since the last update."""
        drawn = self._pool.take_draws() if self._lessons.has_parameters else {}
        return {name: total / count for name, (count, total) in drawn.items()}

    def set_mode(self, policy: str, mode: Mode) -> None:
        """Put a policy into another mode; never while engines are in a step.

        What it has collected and not learnt from yet is dropped.
        """
        learner, slot = self._learners[policy], self._slots[policy]
        if slot.mode != mode:
            if slot.mode == "train" and isinstance(learner, PPO):
                learner.learn_meanwhile()  # with overlap; what is frozen does not change any more
            log.info("policy %s: %s, after %d updates", policy, mode, self.updates)
            slot.set_mode(mode)
        self._note_learning()

    def follow_episodes(self, on_episodes: OnEpisodes) -> None:
        """Have ``on_episodes`` called for the episodes that end, while engines are in a step."""
        self._workers.on_episodes = on_episodes

    def change(self, config: TrainConfig) -> None:
        """Go on with other settings, which differ in those alone that may change.

        Never while engines are in a step.
        """
        for name, settings in config.policies.items():
            learner = self._learners[name]
            if settings.mode != self.config.policies[name].mode:
                self.set_mode(name, settings.mode)
            if isinstance(learner, PPO | SAC):
                cast(Any, learner).config = settings
        self.config = config
        self._schedule = ModeSchedule(config)

    def _note_learning(self) -> None:
        if self._league is not None:
            learning = (name for name, slot in self._slots.items() if slot.mode == "train")
            self._league.learning = frozenset(learning)

    def reason_to_stop(self) -> StopReason | None:
        """Return which limit of the settings is reached, None if there is more to train."""
        config = self.config
        if self.agent_steps >= config.total_steps:
            return "total_steps"
        if config.max_time_s is not None and self.wall_s >= config.max_time_s:
            return "max_time"
        if config.target_return is None or not self._lessons.is_last:
            return None
        is_there = all(
            len(tracker.returns) == config.return_window
            and np.mean(tracker.returns) >= config.target_return
            for tracker in self._trackers.values()
        )
        return "target_return" if is_there else None

    def _reached_limit(self, is_confirmed: Callable[[], bool]) -> StopReason | None:
        """Return :meth:`reason_to_stop`, but a target only where it is confirmed."""
        reason = self.reason_to_stop()
        if reason != "target_return":
            return reason
        self.save()
        if is_confirmed():
            return reason
        self._forget_returns()
        self._reset()
        self._pool.take_metrics()  # of what was played meanwhile, which a reset brings
        return None

    # --- measuring ------------------------------------------------------------------------------

    def _shares(self, before: CollectTimes, update_s: float, total_s: float) -> dict[str, float]:
        now = self._workers.times
        return {
            "wait_share": (now.wait_s - before.wait_s) / total_s,
            "act_share": (now.act_s - before.act_s) / total_s,
            "record_share": (now.record_s - before.record_s) / total_s,
            "update_share": (update_s + now.learn_s - before.learn_s) / total_s,
        }

    def _policy_metrics(
        self, name: str, losses: Mapping[str, dict[str, float]]
    ) -> dict[str, float]:
        tracker, slot = self._trackers[name], self._slots[name]
        values = tracker.summary() | {"episodes": float(tracker.num_episodes)}
        values["is_learning"] = float(slot.mode == "train")
        if self._league is not None:
            values["elo"] = self._league.ratings[name]
        return values | losses.get(name, {})

    def _progress(self, speed: float, policies: Mapping[str, Mapping[str, float]]) -> Progress:
        memory = SPEED_MEMORY if self._steps_per_s else 0.0
        self._steps_per_s = memory * self._steps_per_s + (1.0 - memory) * speed
        left_s = (self.config.total_steps - self.agent_steps) / max(self._steps_per_s, 1e-9)
        if self.config.max_time_s is not None:
            left_s = min(left_s, self.config.max_time_s - self.wall_s)
        return Progress(
            agent_steps=self.agent_steps,
            total_steps=self.config.total_steps,
            wall_s=self.wall_s,
            time_left_s=max(0.0, left_s),
            steps_per_s=self._steps_per_s,
            policies=policies,
            restarts=self._pool.num_restarts,
            modes={name: slot.mode for name, slot in self._slots.items()},
            machines=self._workers.machines,
        )

    # --- saving ---------------------------------------------------------------------------------

    def _is_time_to_save(self) -> bool:
        every_s, every = self.config.checkpoint_every_s, self.config.checkpoint_every_updates
        is_time = every_s is not None and self.wall_s - self._saved_at_s >= every_s
        return is_time or (every is not None and self.updates - self._saved_at_update >= every)

    def save(self) -> None:
        """Write a checkpoint, unless one of the same step is there.

        Raises:
            RunError: The disk is full, or the folder may not be written to.
        """
        path = self._store.write(self._checkpoint())
        self._saved_at_s, self._saved_at_update = self.wall_s, self.updates
        log.debug("saved %s", path)

    def _try_to_save(self) -> None:
        """Save beside an error, which is what the user has to see even if this fails."""
        try:
            self.save()
        except Exception as error:
            log.warning("no checkpoint of step %d: %s", self.agent_steps, error)

    def _keep(self) -> None:
        """Write a checkpoint that stays for ever, if it is time for one."""
        every = self.config.keep_every_updates
        if every is not None and self.updates % every == 0:
            path = self._store.keep(self._checkpoint(), self.updates)
            log.debug("saved %s", path)

    def _save_diverged(self, error: DivergenceError) -> DivergenceError:
        path = self._folder.diverged
        saved = f"the last good checkpoint is in {self._store.folder}"
        try:
            write_checkpoint(path, self._checkpoint())
        except RunError as second:
            log.warning("%s", second.message)
        else:
            log.error("%s; the state is in %s", error.message, path)
            saved = f"the state is in {path}, and {saved}"
        return DivergenceError(error.message, f"{error.hint}; {saved}")

    def _checkpoint(self) -> Checkpoint:
        # In other lessons, returns do not tell which policy is the best at the whole task.
        returns = self.mean_returns().values() if self._lessons.is_last else ()
        run: dict[str, Any] = {
            "updates": self.updates,
            "wall_s": self.wall_s,
            "episodes": {name: tracker.state() for name, tracker in self._trackers.items()},
            "seats": {name: slot.state() for name, slot in self._slots.items()},
            "random": random_state(),
            "lessons": self._lessons.state(),
            "diagnosis": self._diagnosis.state(),
        }
        league: dict[str, Tensor] = {}
        if self._league is not None:
            league, run["league"] = self._league.state()
        policies = self._pool.policies
        return Checkpoint(
            agent_steps=self.agent_steps,
            mean_return=float(np.mean(list(returns))) if returns else None,
            learners={name: learner.state() for name, learner in self._learners.items()},
            specs={name: policy.to_json() for name, policy in policies.items()},
            fingerprints={name: policy.fingerprint() for name, policy in policies.items()},
            config=to_plain(self.config),
            run=run,
            league=league,
        )


def make_league(config: TrainConfig, pool: Pool, policies: Mapping[str, Policy]) -> League | None:
    """Return the league of a run, None without self-play."""
    if config.league.share == 0:
        return None
    return League(config.league, pool.policies, policies, league_seed(config.seed))
