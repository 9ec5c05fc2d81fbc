"""The folder of a run and the files in it.

::

    runs/<target>-<date>-<time>[-n]/
        config.json             effective settings; ``ludus train --config`` reads them
        checkpoints/            see :mod:`ludus.runs.checkpoint`
        metrics.jsonl           see :mod:`ludus.runs.metrics`
        events.out.tfevents…    the same for TensorBoard
        learning_curve.png
        evaluation.json
        result.json             how training ended; absent while it goes on, and after a crash
        train.log
        engine-logs/            what the game processes printed
        control/                requests to the run while it goes on, see :mod:`ludus.runs.control`
        diverged/               a checkpoint for inspection, after a loss became NaN

What needs PyTorch or NumPy is imported where it is used, so that ``ludus runs`` does without.
"""

from __future__ import annotations

import json
import re
import shutil
import time
from collections.abc import Collection, Generator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ludus.disk import disk_errors, write_atomically
from ludus.errors import CheckpointError, ConfigError, RunError
from ludus.locks import LockHeld, file_lock

if TYPE_CHECKING:
    from ludus.runs.checkpoint import CheckpointStore
    from ludus.settings.merging import Layer
    from ludus.settings.train_config import TrainConfig

__all__ = ["RunFolder", "stack_layers"]

LOCK = ".lock"
LOCK_TIMEOUT_S = 1.0
"""Longer than :meth:`RunFolder.is_running` holds the lock."""


@dataclass(frozen=True)
class RunFolder:
    """The folder of one run.

    Attributes:
        path: Where it is.
    """

    path: Path

    @classmethod
    def create(cls, config: TrainConfig) -> RunFolder:
        """Make a new, empty folder.

        Raises:
            RunError: A folder of the name that ``config`` asks for exists, or none can be made.
        """
        stem = config.name or f"{cls.stem(config.target)}-{time.strftime('%Y%m%d-%H%M%S')}"
        path, attempt = config.runs / stem, 1
        with disk_errors(f"the run folder {path}"):
            config.runs.mkdir(parents=True, exist_ok=True)
            while True:
                try:
                    path.mkdir()
                    return cls(path)
                except FileExistsError:
                    if config.name:
                        raise RunError(
                            f"the run {path} exists already",
                            f"to continue it: ludus train --resume {path}; to train another run, "
                            "give it another name: --name NAME",
                        ) from None
                attempt += 1
                path = config.runs / f"{stem}-{attempt}"

    @staticmethod
    def stem(target: str) -> str:
        """Return what names of folders that belong to a target begin with."""
        from ludus.target import GYMNASIUM_PREFIX

        if target.startswith(GYMNASIUM_PREFIX):
            stem = target.removeprefix(GYMNASIUM_PREFIX)
        else:
            stem = Path(target).stem if Path(target).exists() else Path(target).name
        return re.sub(r"[^A-Za-z0-9._-]+", "-", stem).strip("-.") or "run"

    @classmethod
    def find(cls, path: Path) -> RunFolder:
        """Return the folder of an existing run; a checkpoint inside it will do, too.

        Raises:
            CheckpointError: There is no run.
        """
        from ludus.target import find_run  # slow, and a listing of runs does not need it

        run = find_run(path)
        if run is None:
            raise CheckpointError(
                f"{path} is not a run: it has no config.json",
                "name a folder that ludus train made, such as runs/cartpole-…",
            )
        return cls(run.folder)

    @property
    def metrics(self) -> Path:
        """JSON lines, one object per update."""
        return self.path / "metrics.jsonl"

    @property
    def learning_curve(self) -> Path:
        """The picture of the learning curve."""
        return self.path / "learning_curve.png"

    @property
    def engine_logs(self) -> Path:
        """Folder for what the engines print."""
        return self.path / "engine-logs"

    @property
    def control(self) -> Path:
        """Folder for requests to the run."""
        return self.path / "control"

    @property
    def result(self) -> Path:
        """How training ended; absent while it goes on, and after a crash."""
        return self.path / "result.json"

    @property
    def evaluation(self) -> Path:
        """What the evaluation after training has found."""
        return self.path / "evaluation.json"

    @contextmanager
    def locked(self) -> Generator[None, None, None]:
        """Keep every other process from training in this folder.

        Requests to whatever trained here before are void.

        Raises:
            RunError: Another process does so now, or the folder may not be written to.
        """
        with ExitStack() as stack:
            try:
                with disk_errors(f"the run folder {self.path}"):
                    stack.enter_context(file_lock(self.path / LOCK, LOCK_TIMEOUT_S))
            except LockHeld:
                raise RunError(
                    f"the run {self.path} is being trained by another process",
                    f"to stop that one: ludus control {self.path} --stop",
                ) from None
            shutil.rmtree(self.control, ignore_errors=True)
            for path in self.path.glob(".*.tmp"):  # of a process that was killed
                path.unlink(missing_ok=True)
            yield

    def is_running(self) -> bool:
        """Return whether a process is training in this folder now.

        Raises:
            RunError: The lock may not be opened.
        """
        if not (self.path / LOCK).exists():
            return False
        try:
            with disk_errors(str(self.path / LOCK)), file_lock(self.path / LOCK, 0.0):
                return False
        except LockHeld:
            return True

    @property
    def diverged(self) -> Path:
        """Where the state goes after a loss became NaN; a free name."""
        path, attempt = self.path / "diverged", 1
        while path.exists():
            attempt += 1
            path = self.path / f"diverged-{attempt}"
        return path

    def checkpoints(self, keep: int = 3) -> CheckpointStore:
        """Return the store of this run's checkpoints."""
        from ludus.runs.checkpoint import CheckpointStore

        return CheckpointStore(self.path / "checkpoints", keep)

    def read_config(self) -> TrainConfig:
        """Return the effective settings of the run."""
        from ludus.settings.plain import merge_settings, read_file
        from ludus.settings.train_config import TrainConfig

        path = self.path / "config.json"
        return merge_settings(TrainConfig(), read_file(path), str(path))

    def write_config(self, config: TrainConfig, origins: Mapping[str, str] | None = None) -> None:
        """Save the effective settings, and where those come from that are not defaults."""
        from ludus.runs.trust import make_mark
        from ludus.settings.plain import MARK, ORIGINS, to_plain

        plain = to_plain(config)
        where = {} if origins is None else {ORIGINS: dict(origins)}
        mark = make_mark(plain)
        made_by = {} if mark is None else {MARK: mark}
        self.write_json("config.json", plain | where | made_by)

    def write_json(self, name: str, values: dict[str, Any]) -> None:
        """Write a small file into the folder, whole or not at all."""
        path = self.path / name
        with disk_errors(str(path)):
            write_atomically(path, json.dumps(values, indent=2).encode() + b"\n")

    def forget_result(self) -> None:
        """Remove result and evaluation of what trained here before."""
        for path in (self.result, self.evaluation):
            with disk_errors(str(path)):
                path.unlink(missing_ok=True)

    def discard_if_unused(self, but: Collection[str] = ()) -> bool:
        """Remove the folder if it holds nothing; only for who has made it.

        Args:
            but: Names of files and folders in it that count as nothing.

        Returns:
            Whether it was removed.
        """
        for path in self.path.rglob("*"):
            first = path.relative_to(self.path).parts[0]
            is_file = path.is_symlink() or not path.is_dir()
            if is_file and first not in {LOCK, *but}:
                return False
        shutil.rmtree(self.path, ignore_errors=True)
        return True


def stack_layers(
    last: Layer, *, config: Path | None = None, run: RunFolder | None = None
) -> tuple[Layer, ...]:
    """Return the layers of settings of a run, earlier ones first.

    Args:
        last: What was typed, or what a script says.
        config: TOML file, or the ``config.json`` of a run.
        run: The run that goes on.

    Raises:
        ConfigError: A file cannot be read or is malformed.
        UsageError: A run that Ludus did not make names a program.
    """
    from ludus.runs.trust import PROGRAM_SETTINGS, require_trust
    from ludus.settings.merging import Layer
    from ludus.settings.plain import read_file

    files = [] if run is None else [(run.path / "config.json", f"run {run.path}", True)]
    if config is not None:
        files.append((config, f"file {config}", config.suffix == ".json"))
    layers = [Layer(origin, read_file(path), is_saved) for path, origin, is_saved in files]
    # Every run has saved a target, though an empty one where a script opened the game.
    if run is not None and "target" not in layers[0].values:
        raise ConfigError(
            f"{files[0][0]} lacks the setting target, so no run saved it",
            "bring back the file, or start a new run",
        )
    layers.append(last)
    for index, (path, _, is_saved) in enumerate(files):
        if is_saved:
            over = set[str]().union(*(layer.values for layer in layers[index + 1 :]))
            kept = {k: v for k, v in layers[index].values.items() if k not in over}
            require_trust(path, {k: v for k, v in kept.items() if k in PROGRAM_SETTINGS})
    return tuple(layers)
