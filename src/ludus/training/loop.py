"""A training run from start to end."""

from __future__ import annotations

import contextlib
import json
import logging
import re
import shlex
import sys
from collections import Counter
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch

from ludus.algorithms.learner import Learner
from ludus.algorithms.learners import OwnParts, make_learners
from ludus.datasets import require_minari
from ludus.disk import plain_file_opener
from ludus.engine.output import count_errors
from ludus.errors import CheckpointError, DivergenceError, RunError, UsageError
from ludus.play.evaluation import Evaluation
from ludus.pool import EnginePool, Pool, PoolConfig, open_pool
from ludus.printing import PrintableFormatter
from ludus.runs.checkpoint import Checkpoint, CorruptError, checkpoint_errors, resume_spec
from ludus.runs.curve import draw_learning_curve
from ludus.runs.metrics import MetricsLog
from ludus.runs.run_folder import RunFolder
from ludus.runs.tracking import require_trackers
from ludus.settings.merging import Layer, Resolved, changes_since, merge, python_layer, resolve
from ludus.settings.train_config import TrainConfig
from ludus.target import check_accepted, parse_target
from ludus.training.callback import RunCallback
from ludus.training.final_evaluation import FinalEvaluation
from ludus.training.hooks import Hooks, Training
from ludus.training.interrupt import Interrupts
from ludus.training.progress import Reporter, RunResult, SilentReporter, StopReason
from ludus.training.trainer import Trainer
from ludus.workers.opening import open_machines

__all__ = ["log_file", "open_training_pool", "require_pool", "train", "write_result"]

log = logging.getLogger(__name__)

NUM_ERRORS = 5
"""Errors of the game that are named at the end of training."""


def train(
    config: TrainConfig | Sequence[Layer],
    *,
    pool: Pool | None = None,
    resume: Path | None = None,
    reporter: Reporter | None = None,
    hooks: Hooks | None = None,
    own: OwnParts | None = None,
) -> RunResult:
    """Train every policy of a target, leave a run folder, evaluate.

    Ctrl-C and SIGTERM end training early with a checkpoint; the result says so.

    Args:
        config: Settings, as a whole or in layers. Those of a policy are laid over its scene's,
            see :func:`ludus.settings.merging.resolve`.
        pool: Train in this one and leave it open; None opens what ``config`` names.
        resume: Folder of a run to go on with, from its newest checkpoint.
        reporter: Is told how it goes.
        hooks: Callbacks of a script.
        own: Networks and learners of a script.

    Raises:
        UsageError: ``pool`` is none, or does not go with ``config.cluster``.
        ConfigError: A setting is unknown or does not fit.
        CheckpointError: The run to resume has no checkpoint that fits.
        DivergenceError: A loss became NaN; the state lies in the run folder under ``diverged``.
        RunError: A file cannot be written.
        EngineError: An engine failed for good; a checkpoint was written.
    """
    require_pool(pool)
    parts = RunParts(reporter or SilentReporter(), hooks or Hooks(), own or OwnParts())
    layers = [python_layer(config)] if isinstance(config, TrainConfig) else config
    before = merge(layers)
    require_trackers(before.track)
    if before.imitate is not None:
        require_minari()
    _check_cluster(before, pool, parts.own)
    folder = RunFolder.find(resume) if resume else RunFolder.create(before)
    log_sizes = _log_sizes(folder)
    try:
        with folder.locked(), _pool_for(before, pool, folder) as source, log_file(folder):
            for warning in source.spec.warnings:
                log.warning("%s", warning)
            resolved = resolve(layers, source.policies)
            try:
                return _train_in(source, resolved, folder, resume is not None, parts)
            finally:
                _sum_up_errors(folder, log_sizes)
    except UsageError:
        if resume is None:  # what was asked for is wrong
            folder.discard_if_unused(but=[folder.engine_logs.name])
        raise
    finally:
        if resume is None:
            folder.discard_if_unused()


def _log_sizes(folder: RunFolder) -> dict[Path, int]:
    return {path: path.stat().st_size for path in folder.engine_logs.glob("*.log")}


def _sum_up_errors(folder: RunFolder, sizes: Mapping[Path, int]) -> None:
    """Say how often the games printed each error, which nobody would look for in their logs."""
    counts = Counter[str]()
    for path in sorted(folder.engine_logs.glob("*.log")):
        counts.update(count_errors(path, sizes.get(path, 0)))
    for error, count in counts.most_common(NUM_ERRORS):
        log.warning("the game printed %d × %s", count, error)
    if counts:
        log.warning("all that it printed is in %s", folder.engine_logs)


@dataclass(frozen=True)
class RunParts:
    """What a caller adds to the settings of a run."""

    reporter: Reporter
    hooks: Hooks
    own: OwnParts


def _train_in(
    pool: Pool, resolved: Resolved, folder: RunFolder, is_resumed: bool, parts: RunParts
) -> RunResult:
    config, reporter = resolved.config, parts.reporter
    torch.set_num_threads(config.torch_threads)

    def make_trainer() -> tuple[Trainer, dict[str, Learner]]:
        learners = make_learners(
            config, pool, parts.own, is_new=not is_resumed, on_cloning=reporter.cloning
        )
        return Trainer(config, pool, learners, folder), learners

    if is_resumed:
        trainer, learners = _resume(make_trainer, pool, config, folder)
        reason = trainer.reason_to_stop()
        if reason is not None and folder.evaluation.exists():
            _name_limit(reason, config, folder)
            saved = json.loads(folder.evaluation.read_bytes())
            evaluation = {
                name: Evaluation.of(of["returns"], of["lengths"]) for name, of in saved.items()
            }
            return _result(trainer, folder, reason, evaluation=evaluation)
        if config.max_time_s is not None:
            left_s = config.max_time_s - trainer.wall_s
            log.warning("max_time_s is %g s: %.0f s of it are left", config.max_time_s, left_s)
    else:
        trainer, learners = make_trainer()
    folder.write_config(config, resolved.origins)
    folder.forget_result()
    reporter.started(config, folder.path)
    last = FinalEvaluation(trainer, learners, pool, reporter)
    try:
        with Interrupts() as interrupts:
            training = Training(trainer, folder, resolved.origins)
            callback = RunCallback(trainer, pool, training, parts.hooks)
            stop_reason = trainer.run(interrupts.is_stopping, reporter, callback, last.is_confirmed)
    except DivergenceError:
        write_result(trainer, folder, "diverged")
        raise
    except Exception as error:
        with contextlib.suppress(RunError):  # the disk that is full is the first error
            write_result(trainer, folder, "failed", error=error)
        raise
    config = trainer.config
    write_result(trainer, folder, stop_reason)
    title = f"{config.target or folder.path.name}"
    draw_learning_curve(folder.metrics, folder.learning_curve, title)
    evaluation = last.play() if stop_reason != "interrupted" else {}
    if evaluation:
        saved = {name: asdict(of) for name, of in evaluation.items()}
        folder.write_json(folder.evaluation.name, saved)
        trainer.compare(evaluation)
        write_result(trainer, folder, stop_reason, evaluation)
    return _result(trainer, folder, stop_reason, signum=interrupts.signum, evaluation=evaluation)


def _resume(
    make_trainer: Callable[[], tuple[Trainer, dict[str, Learner]]],
    pool: Pool,
    config: TrainConfig,
    folder: RunFolder,
) -> tuple[Trainer, dict[str, Learner]]:
    """Return trainer and learners as of the run's newest checkpoint that can be loaded.

    Raises:
        CheckpointError: There is none that fits.
    """

    def take(path: Path, checkpoint: Checkpoint) -> tuple[Trainer, dict[str, Learner]]:
        resume_spec(checkpoint, pool, path)
        changes = changes_since(checkpoint.config, config)
        texts = [f"{name} is {change}" for name, change in changes.items()]
        _refuse_other_algorithms(texts, path)
        made = make_trainer()
        try:
            with checkpoint_errors(path):
                made[0].resume(checkpoint)
        except CheckpointError as error:
            own = [text for text in texts if text.startswith("policies.")]
            if own and not isinstance(error, CorruptError):
                raise _misfit(path, own) from error
            raise
        log.info("resumed from %s", path)
        if texts:
            log.warning("%s goes on with other settings: %s", folder.path, "; ".join(texts))
        return made

    store = folder.checkpoints(config.keep_checkpoints)
    store.clean()
    trainer, learners = store.resume(take)
    MetricsLog.forget_after(folder.metrics, trainer.agent_steps)
    return trainer, learners


def _name_limit(reason: StopReason, config: TrainConfig, folder: RunFolder) -> None:
    """Say why a run that was to go on has nothing left to do."""
    setting = "max_time_s" if reason == "max_time" else reason
    limit: float = getattr(config, setting)
    log.warning(
        "%s is finished: it has reached its %s of %s; to train it further, raise that: "
        "ludus train --resume %s --%s …",
        folder.path, setting, f"{limit:,}" if isinstance(limit, int) else f"{limit:g}",
        shlex.quote(str(folder.path)), setting.replace("_", "-"),
    )  # fmt: skip


def _result(
    trainer: Trainer, folder: RunFolder, stop_reason: StopReason, *,
    signum: int | None = None, evaluation: Mapping[str, Evaluation] | None = None,
) -> RunResult:  # fmt: skip
    return RunResult(
        path=folder.path,
        stop_reason=stop_reason,
        signum=signum,
        agent_steps=trainer.agent_steps,
        updates=trainer.updates,
        wall_s=trainer.wall_s,
        mean_return=trainer.mean_returns(),
        evaluation=dict(evaluation or {}),
    )


def _refuse_other_algorithms(changes: Sequence[str], path: Path) -> None:
    algorithms = [text for text in changes if re.match(r"policies\..*\.algorithm is ", text)]
    if algorithms:
        raise _misfit(path, algorithms)


def _misfit(path: Path, changes: Sequence[str]) -> CheckpointError:
    return CheckpointError(
        f"{path} does not fit the settings: {'; '.join(changes)}",
        "leave out those that change the network, or start a new run",
    )


def write_result(
    trainer: Trainer,
    folder: RunFolder,
    stop_reason: str,
    evaluation: Mapping[str, Evaluation] | None = None,
    *,
    error: Exception | None = None,
) -> None:
    """Leave what ``ludus runs`` tells; see :func:`ludus.runs.run_list.list_runs`."""
    values: dict[str, Any] = {
        "stop_reason": stop_reason,
        "agent_steps": trainer.agent_steps,
        "updates": trainer.updates,
        "wall_s": trainer.wall_s,
        "mean_return": trainer.mean_returns(),
        "evaluation": {name: of.mean_return for name, of in (evaluation or {}).items()},
    }
    if error is not None:
        values["error"] = f"{type(error).__name__}: {error}"
    folder.write_json(folder.result.name, values)


def require_pool(pool: object) -> None:
    """Refuse what is no pool; None is allowed.

    Raises:
        UsageError: It is something else.
    """
    if pool is not None and not hasattr(pool, "receive"):
        raise UsageError(
            f"pool must be what ludus.open_pool returns, not {type(pool).__name__}",
            "of an environment of Ludus, pool=env.pool",
        )


def _check_cluster(config: TrainConfig, pool: Pool | None, own: OwnParts) -> None:
    if config.cluster is not None and pool is not None:
        raise UsageError(
            "cluster and pool exclude each other: the engines of a pool are here",
            "leave out one of them",
        )
    if config.cluster is not None and own.networks:
        raise UsageError(
            "networks of a script stay in the script's process, and cannot act on a cluster",
            "leave out cluster, or use Ludus's own networks (hidden_sizes, memory_size)",
        )


def open_training_pool(
    config: TrainConfig, log_dir: Path | None = None, command: str = "train"
) -> EnginePool:
    """Open the pool that the settings of a run ask for; close it when done.

    Args:
        config: Target, worlds, engines and what goes with them.
        log_dir: Where engines leave their output; None keeps it with the system's logs.
        command: What the user asked for.

    Raises:
        TargetError: The target does not exist, or this command cannot open it.
        EngineError: The engine did not start.
    """
    target = parse_target(config.target, scene=config.scene, godot=config.godot)
    check_accepted(command, target)
    return open_pool(target, PoolConfig.of(config, log_dir=log_dir))


@contextmanager
def _pool_for(
    config: TrainConfig, pool: Pool | None, folder: RunFolder
) -> Generator[Pool, None, None]:
    if pool is not None:
        before = pool.world_parameters if isinstance(pool, EnginePool) else None
        try:
            yield pool
        finally:
            if isinstance(pool, EnginePool):
                pool.world_parameters = before
        return
    if config.cluster is not None:
        opened = open_machines(config, folder.engine_logs)
    else:
        opened = open_training_pool(config, folder.engine_logs)
    with contextlib.closing(opened):
        yield opened


@contextmanager
def log_file(folder: RunFolder) -> Generator[None, None, None]:
    """Send what ``ludus`` logs to ``train.log`` as well."""
    handler = _RunLog(folder.path / "train.log", encoding="utf-8", errors="backslashreplace",
                      delay=True)  # fmt: skip
    handler.setFormatter(PrintableFormatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
    logger = logging.getLogger("ludus")
    handlers: list[logging.Handler] = [handler]
    if logging.lastResort is not None and not logger.hasHandlers():
        handlers.append(logging.lastResort)  # Python uses it only if there is no other handler
    for each in handlers:
        logger.addHandler(each)
    try:
        yield
    finally:
        for each in handlers:
            logger.removeHandler(each)
        handler.close()


class _RunLog(logging.FileHandler):
    """A log that a run does without if it cannot be written."""

    def _open(self) -> Any:
        return open(
            self.baseFilename, self.mode, encoding=self.encoding, errors=self.errors,
            opener=plain_file_opener,
        )  # fmt: skip

    def emit(self, record: logging.LogRecord) -> None:
        if self.stream is None:  # FileHandler opens late, and lets errors of that out
            try:
                self.stream = self._open()
            except OSError as error:
                self._give_up(error)
                return
        super().emit(record)

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802 - of logging
        self._give_up(sys.exc_info()[1])

    def _give_up(self, error: BaseException | None) -> None:
        logging.getLogger("ludus").removeHandler(self)
        log.warning("%s is not written: %s", self.baseFilename, error)
