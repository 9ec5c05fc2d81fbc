"""The run of a game: one that is there goes on, and whatever does not fit it begins anew."""

from __future__ import annotations

import logging
import re
import secrets
import shutil
from collections.abc import Generator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

from ludus.algorithms.learner import Learner
from ludus.algorithms.learners import make_learners
from ludus.disk import disk_errors
from ludus.errors import CheckpointError, DivergenceError, RunError
from ludus.pool.interface import Pool
from ludus.runs.checkpoint import Checkpoint
from ludus.runs.curve import draw_learning_curve
from ludus.runs.metrics import MetricsLog
from ludus.runs.run_folder import RunFolder
from ludus.settings.train_config import TrainConfig
from ludus.training.loop import complete, log_file, write_result
from ludus.training.trainer import Trainer

__all__ = ["GameRun", "game_config", "opened_run"]

NO_LIMIT = 10**15
"""Agent steps of a run that ends when somebody says so."""
POLICIES = "policies"
UNNAMED = "game"

log = logging.getLogger(__name__)


@dataclass
class GameRun:
    """A run that is ready to be trained.

    Attributes:
        folder: Where it is; nobody else trains there.
        trainer: Trains it.
        learners: By policy.
        config: Effective settings.
        message: How it came to be, a sentence for people.
        stop_reason: How training ended, for ``ludus runs``.
    """

    folder: RunFolder
    trainer: Trainer
    learners: Mapping[str, Learner]
    config: TrainConfig
    message: str
    stop_reason: str = "stopped"

    @property
    def policies_folder(self) -> Path:
        """Where policies are written unless somewhere else."""
        return self.folder.path / POLICIES

    def end(self) -> None:
        """Leave how training ended; a run in which nothing was trained or written is removed.

        Raises:
            RunError: A file cannot be written.
        """
        if not self.folder.checkpoints().paths() and not self.policies_folder.exists():
            shutil.rmtree(self.folder.path, ignore_errors=True)
            return
        write_result(self.trainer, self.folder, self.stop_reason)
        draw_learning_curve(self.folder.metrics, self.folder.learning_curve, self.folder.path.name)


def game_config(config: TrainConfig, name: str | None, pool: Pool) -> TrainConfig:
    """Return the settings of a game's run: those of its scene, in the folder of its name.

    The seed stays none if it is: a run that goes on has one already.

    Raises:
        ConfigError: A setting of the scene is unknown, or does not fit.
    """
    stem = re.sub(r"[^\w.-]+", "-", PurePosixPath(pool.spec.scene).stem).strip(".-")
    named = replace(
        config,
        target="play",
        num_worlds=pool.spec.num_worlds,
        num_engines=1,
        total_steps=NO_LIMIT,
        evaluation_episodes=0,
        name=name or stem or UNNAMED,
    )
    return replace(complete(named, pool.policies), seed=config.seed)


@contextmanager
def opened_run(config: TrainConfig, pool: Pool) -> Generator[GameRun, None, None]:
    """Find or make the run that ``config`` names, and hold it until the context ends.

    Args:
        config: As :func:`game_config` makes it. Its seed is that of a new run; none draws one.
        pool: The game.

    Raises:
        RunError: Another process trains it, the folder is something else, or cannot be written to.
        ConfigError: A setting does not fit.
    """
    folder = RunFolder(config.runs / config.name)
    with ExitStack() as stack:
        _hold(stack, folder)
        try:
            run = _resumed(config, pool, folder)
        except CheckpointError as error:
            stack.close()
            aside = _put_aside(folder)
            _hold(stack, folder)
            run = replace(_begun(config, pool, folder), message=_explain(aside, error))
        run = run or _begun(config, pool, folder)
        folder.write_config(run.config)
        folder.forget_result()
        run.trainer.begin()
        try:
            yield run
        except DivergenceError:
            run.stop_reason = "diverged"
            raise
        finally:
            run.end()


def _hold(stack: ExitStack, folder: RunFolder) -> None:
    """Make the folder if need be, and keep everybody else out of it."""
    with disk_errors(f"the run folder {folder.path}"):
        folder.path.mkdir(parents=True, exist_ok=True)
    stack.enter_context(folder.locked())
    is_run = (folder.path / "config.json").is_file()
    if not is_run and any(not path.name.startswith(".") for path in folder.path.iterdir()):
        raise RunError(
            f"the folder {folder.path} is there, and is no run",
            "give the run of the game another name, or move the folder away",
        )
    stack.enter_context(log_file(folder))


def _begun(config: TrainConfig, pool: Pool, folder: RunFolder) -> GameRun:
    if config.seed is None:
        config = replace(config, seed=secrets.randbits(31))
    return _run(config, pool, folder, f"new run {folder.path.name}")


def _run(config: TrainConfig, pool: Pool, folder: RunFolder, message: str) -> GameRun:
    learners = make_learners(config, pool)
    trainer = Trainer(config, pool, learners, folder)
    return GameRun(folder, trainer, learners, config, message)


def _resumed(config: TrainConfig, pool: Pool, folder: RunFolder) -> GameRun | None:
    """Return the run as its newest checkpoint has it; None if it has none.

    Raises:
        CheckpointError: There is none that fits.
    """
    store = folder.checkpoints(config.keep_checkpoints)
    store.clean()
    if not store.paths():
        return None
    path, checkpoint = store.newest(has_replay=True, set_aside=True)
    _check_fit(checkpoint, config, pool, path)
    config = replace(config, seed=checkpoint.config.get("seed"))
    message = f"{folder.path.name} goes on at {checkpoint.agent_steps} steps"
    try:
        run = _resume(config, pool, folder, checkpoint)
    except CheckpointError:
        if not any(learner.replay for learner in checkpoint.learners.values()):
            raise
        run = _resume(config, pool, folder, _without_replay(checkpoint))
        message += ", without its replay, which does not fit any more"
    MetricsLog.forget_after(folder.metrics, checkpoint.agent_steps)
    log.info("resumed from %s", path)
    return replace(run, message=message)


def _resume(config: TrainConfig, pool: Pool, folder: RunFolder, checkpoint: Checkpoint) -> GameRun:
    run = _run(config, pool, folder, "")
    try:
        run.trainer.resume(checkpoint)
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        raise CheckpointError(f"it does not fit: {type(error).__name__}: {error}") from None
    return run


def _without_replay(checkpoint: Checkpoint) -> Checkpoint:
    learners = {name: replace(of, replay={}) for name, of in checkpoint.learners.items()}
    return replace(checkpoint, learners=learners)


def _check_fit(checkpoint: Checkpoint, config: TrainConfig, pool: Pool, path: Path) -> None:
    """Refuse a checkpoint of other policies, which must neither be used nor overwritten.

    Raises:
        CheckpointError: It names what differs.
    """
    ours = {name: policy.fingerprint() for name, policy in pool.policies.items()}
    for name in sorted(ours.keys() | checkpoint.fingerprints.keys()):
        if ours.get(name) != checkpoint.fingerprints.get(name):
            raise CheckpointError(f"{path} has other observations or actions of policy {name}")
        before = checkpoint.config.get("policies", {}).get(name, {}).get("algorithm")
        if before != config.policies[name].algorithm:
            raise CheckpointError(f"{path} has policy {name} trained by {before}")


def _put_aside(folder: RunFolder) -> Path:
    """Give the run a name of its own, under which it stays."""
    attempt = 1
    while (aside := folder.path.with_name(f"{folder.path.name}.old-{attempt}")).exists():
        attempt += 1
    with disk_errors(f"the folder {aside}"):
        folder.path.rename(aside)
    return aside


def _explain(aside: Path, error: CheckpointError) -> str:
    return f"new run; the one that was there is kept as {aside.name}: {error.message}"
