"""A training run from start to end."""

from __future__ import annotations

import logging
import secrets
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path

import torch

from ludus.algorithms.learner import Learner
from ludus.algorithms.learners import make_learners
from ludus.errors import DivergenceError, RunError, UsageError
from ludus.play.evaluation import MAX_STEPS, Evaluation, evaluate
from ludus.play.players import trained_player
from ludus.pool.interface import Pool
from ludus.runs.checkpoint import check_spec
from ludus.runs.curve import draw_learning_curve
from ludus.runs.metrics import MetricsLog
from ludus.runs.run_folder import RunFolder
from ludus.settings.merging import policy_settings
from ludus.settings.train_config import TrainConfig
from ludus.spec import PolicySpec
from ludus.training.interrupt import Interrupts
from ludus.training.progress import Reporter, RunResult, SilentReporter
from ludus.training.source import open_source
from ludus.training.trainer import Trainer

__all__ = ["Configure", "complete", "log_file", "train", "write_result"]

log = logging.getLogger(__name__)

ENDLESS_STEPS = 10_000
"""Steps that the evaluation waits for episodes whose length nothing limits."""

Configure = Callable[[Mapping[str, PolicySpec]], TrainConfig]


def train(
    config: TrainConfig,
    *,
    pool: Pool | None = None,
    resume: Path | None = None,
    configure: Configure | None = None,
    reporter: Reporter | None = None,
) -> RunResult:
    """Train every policy of a target, leave a run folder, evaluate.

    Ctrl-C and SIGTERM end training early with a checkpoint; the result says so.

    Args:
        config: Settings. Those of a policy are laid over its scene's, see
            :func:`ludus.settings.merging.policy_settings`.
        pool: Train in this one and leave it open; None opens what ``config`` names.
        resume: Folder of a run to go on with, from its newest checkpoint.
        configure: Gives the settings once the game's policies are known; None keeps ``config``.
        reporter: Is told how it goes.

    Raises:
        ConfigError: A setting is unknown or does not fit.
        CheckpointError: The run to resume has no checkpoint that fits.
        DivergenceError: A loss became NaN; the state lies in the run folder under ``diverged``.
        RunError: A file cannot be written.
        EngineError: An engine failed for good; a checkpoint was written.
    """
    reporter = reporter or SilentReporter()
    folder = RunFolder.find(resume) if resume else RunFolder.create(config)
    try:
        with folder.locked(), _pool_for(config, pool, folder) as source, log_file(folder):
            config = complete(configure(source.policies) if configure else config, source.policies)
            return _train_in(source, config, folder, resume is not None, reporter)
    except UsageError:
        folder.discard_if_unused(but=folder.engine_logs)  # what was asked for is wrong
        raise
    finally:
        folder.discard_if_unused()


def complete(config: TrainConfig, policies: Mapping[str, PolicySpec]) -> TrainConfig:
    """Return the effective settings: a seed, and settings for every policy there is."""
    settings = {name: policy_settings(config, spec) for name, spec in policies.items()}
    seed = secrets.randbits(31) if config.seed is None else config.seed
    return replace(config, policies=settings, seed=seed)


def _train_in(
    pool: Pool, config: TrainConfig, folder: RunFolder, is_resumed: bool, reporter: Reporter
) -> RunResult:
    torch.set_num_threads(config.torch_threads)
    learners = make_learners(config, pool)
    trainer = Trainer(config, pool, learners, folder)
    if is_resumed:
        store = folder.checkpoints(config.keep_checkpoints)
        store.clean()
        path, checkpoint = store.newest(has_replay=True, set_aside=True)
        check_spec(checkpoint.fingerprints, pool.policies, path)
        trainer.resume(checkpoint)
        MetricsLog.forget_after(folder.metrics, checkpoint.agent_steps)
        log.info("resumed from %s", path)
    folder.write_config(config)
    folder.forget_result()
    reporter.started(config, folder.path)
    try:
        with Interrupts() as interrupts:
            stop_reason = trainer.run(interrupts.is_stopping, reporter)
    except DivergenceError:
        write_result(trainer, folder, "diverged")
        raise
    write_result(trainer, folder, stop_reason)
    title = f"{config.target or folder.path.name}"
    draw_learning_curve(folder.metrics, folder.learning_curve, title)
    evaluation: dict[str, Evaluation] = {}
    if stop_reason != "interrupted" and config.evaluation_episodes:
        reporter.evaluating(config.evaluation_episodes)
        evaluation = _evaluate(learners, pool, config, folder)
        write_result(trainer, folder, stop_reason, evaluation)
    return RunResult(
        run=folder.path,
        stop_reason=stop_reason,
        signum=interrupts.signum,
        agent_steps=trainer.agent_steps,
        updates=trainer.updates,
        wall_s=trainer.wall_s,
        mean_return=trainer.mean_returns(),
        evaluation=evaluation,
    )


def write_result(
    trainer: Trainer,
    folder: RunFolder,
    stop_reason: str,
    evaluation: Mapping[str, Evaluation] | None = None,
) -> None:
    """Leave what ``ludus runs`` tells; see :func:`ludus.runs.run_list.list_runs`."""
    values = {
        "stop_reason": stop_reason,
        "agent_steps": trainer.agent_steps,
        "updates": trainer.updates,
        "wall_s": trainer.wall_s,
        "mean_return": trainer.mean_returns(),
        "evaluation": {name: of.mean_return for name, of in (evaluation or {}).items()},
    }
    folder.write_json(folder.result.name, values)


def _evaluate(
    learners: Mapping[str, Learner], pool: Pool, config: TrainConfig, folder: RunFolder
) -> dict[str, Evaluation]:
    policies = {name: learner.policy for name, learner in learners.items()}
    seed = (config.seed or 0) + 1_000_003  # worlds that training did not begin with
    has_limits = all(policy.max_episode_steps for policy in pool.policies.values())
    max_steps = MAX_STEPS if has_limits else ENDLESS_STEPS
    num_episodes = config.evaluation_episodes
    try:
        act = trained_player(policies, pool, seed)
        evaluation = evaluate(act, pool, num_episodes, seed=seed, max_steps=max_steps)
    except RunError as error:
        # The run itself is whole; an agent that has learned to survive may play for ever.
        log.warning("no evaluation: %s; %s", error.message, error.hint)
        return {}
    folder.write_json("evaluation.json", {name: asdict(of) for name, of in evaluation.items()})
    return evaluation


@contextmanager
def _pool_for(
    config: TrainConfig, pool: Pool | None, folder: RunFolder
) -> Generator[Pool, None, None]:
    if pool is not None:
        yield pool
        return
    opened = open_source(config, folder.engine_logs)
    try:
        yield opened
    finally:
        opened.close()


@contextmanager
def log_file(folder: RunFolder) -> Generator[None, None, None]:
    """Send what ``ludus`` logs to ``train.log`` as well."""
    handler = logging.FileHandler(folder.path / "train.log", encoding="utf-8", delay=True)
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
    logger = logging.getLogger("ludus")
    logger.addHandler(handler)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        handler.close()
