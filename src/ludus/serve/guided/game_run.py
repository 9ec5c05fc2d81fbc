"""The run of a game: resume the one of its name, or start a new one if that does not match."""

from __future__ import annotations

import logging
import re
import secrets
from collections.abc import Generator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

from ludus.algorithms.learner import Learner
from ludus.algorithms.learners import make_learners
from ludus.disk import disk_errors
from ludus.errors import CheckpointError, DivergenceError, RunError
from ludus.pool.interface import Pool
from ludus.runs.checkpoint import Checkpoint, checkpoint_errors
from ludus.runs.curve import draw_learning_curve
from ludus.runs.metrics import MetricsLog
from ludus.runs.run_folder import RunFolder
from ludus.settings.merging import python_layer, resolve
from ludus.settings.train_config import TrainConfig
from ludus.training.loop import log_file, write_result
from ludus.training.trainer import Trainer

__all__ = ["GameRun", "game_config", "opened_run"]

NO_LIMIT = 10**15
"""Total agent steps of a run that trains until it is stopped."""
POLICIES = "policies"
UNNAMED = "game"
SETUP_FILES = ("config.json", "train.log")
"""What a run has before anything is trained."""

log = logging.getLogger(__name__)


@dataclass
class GameRun:
    """A run that is ready for training.

    Attributes:
        folder: Its folder, locked against other processes.
        trainer: Its trainer.
        learners: Learners by policy.
        config: Effective settings.
        message: Whether it is new or resumed, as a sentence for people.
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
        """Default folder for exported policies."""
        return self.folder.path / POLICIES

    def end(self) -> None:
        """Write how training ended.

        Raises:
            RunError: A file cannot be written.
        """
        write_result(self.trainer, self.folder, self.stop_reason)
        draw_learning_curve(self.folder.metrics, self.folder.learning_curve, self.folder.path.name)


def game_config(config: TrainConfig, name: str | None, pool: Pool) -> TrainConfig:
    """Return the settings of a game's run: those of its scene, in the folder of its name.

    A seed of None stays None, since a resumed run has a seed already.

    Raises:
        ConfigError: A setting of the scene is unknown or not valid.
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
    resolved = resolve([python_layer(named)], pool.policies)
    return replace(resolved.config, seed=config.seed)


@contextmanager
def opened_run(config: TrainConfig, pool: Pool) -> Generator[GameRun, None, None]:
    """Resume or create the run that ``config`` names, and lock it until the context ends.

    Args:
        config: Result of :func:`game_config`. Its seed is for a new run; None: random.
        pool: The game.

    Raises:
        RunError: Another process trains the run, or its folder is not a run or not writable.
        ConfigError: A setting is not valid.
    """
    folder = RunFolder(config.runs / config.name)
    with ExitStack() as stack:
        is_new = _hold(stack, folder)
        try:
            run = _resume(config, pool, folder) or _create(config, pool, folder)
        except CheckpointError as error:
            stack.close()
            kept = _rename_old(folder)
            is_new = _hold(stack, folder)
            message = f"new run; the previous one is kept as {kept.name}: {error.message}"
            run = replace(_create(config, pool, folder), message=message)
        folder.write_config(run.config)
        folder.forget_result()
        run.trainer.begin()
        try:
            yield run
        except DivergenceError:
            run.stop_reason = "diverged"
            raise
        finally:
            if not is_new or not folder.discard_if_unused(SETUP_FILES):
                run.end()


def _hold(stack: ExitStack, folder: RunFolder) -> bool:
    """Create the folder if it is missing, lock it, and return whether it was missing."""
    with disk_errors(f"the run folder {folder.path}"):
        is_new = not folder.path.exists()
        folder.path.mkdir(parents=True, exist_ok=True)
    stack.enter_context(folder.locked())
    is_run = (folder.path / "config.json").is_file()
    if not is_run and any(not path.name.startswith(".") for path in folder.path.iterdir()):
        raise RunError(
            f"the folder {folder.path} exists and is not a run",
            "give the game's run another name, or move the folder away",
        )
    stack.enter_context(log_file(folder))
    return is_new


def _create(config: TrainConfig, pool: Pool, folder: RunFolder) -> GameRun:
    if config.seed is None:
        config = replace(config, seed=secrets.randbits(31))
    return _make_run(config, pool, folder, f"new run {folder.path.name}", is_new=True)


def _make_run(
    config: TrainConfig, pool: Pool, folder: RunFolder, message: str, *, is_new: bool = False
) -> GameRun:
    learners = make_learners(config, pool, is_new=is_new)
    trainer = Trainer(config, pool, learners, folder)
    return GameRun(folder, trainer, learners, config, message)


def _resume(config: TrainConfig, pool: Pool, folder: RunFolder) -> GameRun | None:
    """Return the run as of its newest checkpoint; None if it has no checkpoints.

    Raises:
        CheckpointError: None of its checkpoints can be used.
    """
    store = folder.checkpoints(config.keep_checkpoints)
    store.clean()
    if not store.paths() and not store.kept():
        return None

    run = store.resume(lambda path, checkpoint: _load(config, pool, folder, (path, checkpoint)))
    MetricsLog.forget_after(folder.metrics, run.trainer.agent_steps)
    return run


def _load(
    config: TrainConfig, pool: Pool, folder: RunFolder, saved: tuple[Path, Checkpoint]
) -> GameRun:
    path, checkpoint = saved
    with checkpoint_errors(path):
        _check_match(checkpoint, config, pool, path)
    config = replace(config, seed=checkpoint.config.get("seed"))
    message = f"{folder.path.name} goes on at {checkpoint.agent_steps} steps"
    run = _make_run(config, pool, folder, message)
    try:
        with checkpoint_errors(path):
            run.trainer.resume(checkpoint)
    except CheckpointError:
        if not any(learner.replay for learner in checkpoint.learners.values()):
            raise
        learners = {name: replace(of, replay={}) for name, of in checkpoint.learners.items()}
        message += ", without its replay, which no longer matches"
        run = _make_run(config, pool, folder, message)
        with checkpoint_errors(path):
            run.trainer.resume(replace(checkpoint, learners=learners))
    log.info("resumed from %s", path)
    return run


def _check_match(checkpoint: Checkpoint, config: TrainConfig, pool: Pool, path: Path) -> None:
    """Refuse a checkpoint of other policies, which must neither be used nor overwritten.

    Raises:
        CheckpointError: The text names what differs.
    """
    ours = {name: policy.fingerprint() for name, policy in pool.policies.items()}
    if ours.keys() == checkpoint.fingerprints.keys():
        for name, policy in pool.policies.items():
            if policy.was_unmasked(checkpoint.fingerprints[name]):
                pool.ignore_masks(name)
                ours[name] = checkpoint.fingerprints[name]
    for name in sorted(ours.keys() | checkpoint.fingerprints.keys()):
        if ours.get(name) != checkpoint.fingerprints.get(name):
            raise CheckpointError(f"in {path} policy {name} has other observations or actions")
        before = checkpoint.config.get("policies", {}).get(name, {}).get("algorithm")
        if before != config.policies[name].algorithm:
            raise CheckpointError(f"in {path} policy {name} was trained with {before}")


def _rename_old(folder: RunFolder) -> Path:
    """Rename the run's folder to one that is free; return the new path."""
    attempt = 1
    while (renamed := folder.path.with_name(f"{folder.path.name}.old-{attempt}")).exists():
        attempt += 1
    with disk_errors(f"the folder {renamed}"):
        folder.path.rename(renamed)
    return renamed
