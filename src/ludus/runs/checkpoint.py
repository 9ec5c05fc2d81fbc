"""Checkpoints: a folder with ``tensors.safetensors`` and ``state.json``, whole or absent.

::

    checkpoints/step-000000122880/
        tensors.safetensors     every tensor, "<policy>/<name>", past selves "@league/…"
        replay.safetensors      replay buffers, in the newest checkpoint only
        state.json              all the rest, and the hashes of the tensors
    checkpoints/update-000000001000/
                                the same, kept for ever; ``keep_every_updates``
    checkpoints/unloadable-step-000000245760/
                                set aside: it could not be loaded when the run was resumed
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import re
import shutil
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar, cast

import torch
from safetensors.torch import load as load_safetensors
from safetensors.torch import save as save_safetensors
from torch import Tensor

from ludus.algorithms.learner import LearnerState
from ludus.disk import (
    disk_errors,
    parse_json,
    read_plain_file,
    sync_folder,
    write_atomically,
    write_synced,
)
from ludus.errors import CheckpointError, ConfigError, LudusError
from ludus.networks.tensors import join_names, with_prefix
from ludus.pool import Pool
from ludus.spec import PolicySpec

__all__ = ["Checkpoint", "CheckpointStore", "CorruptError", "check_spec", "checkpoint_errors",
           "read_checkpoint", "resume_spec", "write_checkpoint"]  # fmt: skip

FORMAT = 2
TENSORS, REPLAY, STATE = "tensors.safetensors", "replay.safetensors", "state.json"
LEAGUE = "@league"
TEMPORARY = ".writing-"
FIELDS: dict[str, type] = {
    "agent_steps": int,
    "learners": dict,
    "specs": dict,
    "fingerprints": dict,
    "config": dict,
    "run": dict,
}
"""Of ``state.json``, with ``mean_return``, which is a number or null."""

SEAL = re.compile(rb'\{"state_sha256": "([0-9a-f]{64})", ')
NUMBERED = re.compile(r"[a-z]+-[0-9]{1,18}", re.ASCII)

Taken = TypeVar("Taken")

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Checkpoint:
    """All that a run needs to go on.

    Attributes:
        agent_steps: Agent steps so far.
        mean_return: Of the last episodes, the mean over policies; None before the first ended.
        learners: State of each policy's learner.
        specs: Each policy's spec as in the handshake.
        fingerprints: Of each policy's spec.
        config: Effective settings.
        run: The rest, as JSON values: counters, episode statistics, random streams.
        league: Past selves, see :meth:`ludus.league.league.League.state`.
    """

    agent_steps: int
    mean_return: float | None
    learners: dict[str, LearnerState]
    specs: dict[str, Any]
    fingerprints: dict[str, str]
    config: dict[str, Any]
    run: dict[str, Any]
    league: dict[str, Tensor] = field(default_factory=dict[str, Tensor])


def write_checkpoint(path: Path, checkpoint: Checkpoint) -> None:
    """Write a checkpoint folder; ``path`` appears complete or not at all.

    Raises:
        RunError: The disk is full, or the folder may not be written to.
    """
    parts = {name: learner.tensors for name, learner in checkpoint.learners.items()}
    replays = {name: learner.replay for name, learner in checkpoint.learners.items()}
    data = _pack({**parts, LEAGUE: checkpoint.league})
    replay = _pack(replays) if any(replays.values()) else None
    state = {
        "format": FORMAT,
        "tensors_sha256": hashlib.sha256(data).hexdigest(),
        "replay_sha256": None if replay is None else hashlib.sha256(replay).hexdigest(),
        "agent_steps": checkpoint.agent_steps,
        "mean_return": checkpoint.mean_return,
        "learners": {name: learner.values for name, learner in checkpoint.learners.items()},
        "specs": checkpoint.specs,
        "fingerprints": checkpoint.fingerprints,
        "config": checkpoint.config,
        "run": checkpoint.run,
    }
    temporary = path.with_name(f"{TEMPORARY}{os.getpid()}-{path.name}")
    with disk_errors(f"the checkpoint {path}"):
        try:
            temporary.mkdir(parents=True)
            write_synced(temporary / TENSORS, data)
            if replay is not None:
                write_synced(temporary / REPLAY, replay)
            write_synced(temporary / STATE, _seal(state))
            sync_folder(temporary)
            temporary.rename(path)
            sync_folder(path.parent)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)


def read_checkpoint(path: Path, *, has_replay: bool = False) -> Checkpoint:
    """Return the checkpoint in a folder.

    Args:
        path: The folder.
        has_replay: Read replay buffers as well, if they are still there.

    Raises:
        CheckpointError: It is missing, incomplete or corrupt.
    """
    state = _read_state(path)
    tensors = _read_tensors(path, TENSORS, state.get("tensors_sha256"))
    replay: dict[str, Tensor] = {}
    if has_replay and state.get("replay_sha256"):
        if os.path.lexists(path / REPLAY):
            replay = _read_tensors(path, REPLAY, state["replay_sha256"])
        else:
            log.warning("%s no longer has its replay buffer, which starts empty", path)
    learners = {
        name: LearnerState(
            with_prefix(tensors, f"{name}/"), values, with_prefix(replay, f"{name}/")
        )
        for name, values in state["learners"].items()
    }
    return Checkpoint(
        agent_steps=state["agent_steps"],
        mean_return=state["mean_return"],
        learners=learners,
        specs=state["specs"],
        fingerprints=state["fingerprints"],
        config=state["config"],
        run=state["run"],
        league=with_prefix(tensors, f"{LEAGUE}/"),
    )


@contextmanager
def checkpoint_errors(path: Path) -> Generator[None, None, None]:
    """Turn whatever a checkpoint of unexpected contents can raise into an error that names it.

    Raises:
        CheckpointError: Settings were wrong, or something that is no error of Ludus was raised.
    """
    try:
        yield
    except ConfigError as error:
        raise _corrupt(path, error.message) from error
    except (LudusError, MemoryError, torch.cuda.OutOfMemoryError):
        raise  # the last two say nothing about the checkpoint
    except Exception as error:
        raise _corrupt(path, f"{type(error).__name__}: {error}") from error


class CorruptError(CheckpointError):
    """A checkpoint is damaged; an older one may not be."""


class _MissingError(CheckpointError):
    """A checkpoint is not there."""


def _pack(parts: Mapping[str, Mapping[str, Tensor]]) -> bytes:
    tensors = join_names(parts, "/")
    return save_safetensors({name: tensor.contiguous() for name, tensor in tensors.items()})


def _read_tensors(path: Path, name: str, sha256: object) -> dict[str, Tensor]:
    try:
        data = read_plain_file(path / name)
    except OSError as error:
        raise _corrupt(path, f"{name}: {error.strerror}") from None
    if hashlib.sha256(data).hexdigest() != sha256:
        raise _corrupt(path, f"{name} has changed since it was saved")
    with checkpoint_errors(path):
        return load_safetensors(data)


def check_spec(checkpoint: Checkpoint, policies: Mapping[str, PolicySpec], path: Path) -> None:
    """Refuse a checkpoint that was trained for other observations or actions.

    One from before the game had action masks passes, with a warning.

    Raises:
        CheckpointError: It names the policy, and what has changed.
    """
    fingerprints = checkpoint.fingerprints
    hint = "use the scene and version it was trained in, or start a new run"
    if missing := sorted(policies.keys() - fingerprints.keys()):
        raise CheckpointError(
            f"{path} has no policy {missing[0]}; it has {', '.join(fingerprints)}", hint
        )
    for name, policy in policies.items():
        if policy.was_unmasked(fingerprints[name]):
            log.warning("policy %s of %s was trained without the game's action masks", name, path)
        elif fingerprints[name] != policy.fingerprint():
            text = f"{path} was trained for other observations or actions of policy {name}"
            with checkpoint_errors(path):
                change = policy.change_since(checkpoint.specs[name])
            raise CheckpointError(f"{text}: {change}" if change else text, hint)


def resume_spec(checkpoint: Checkpoint, pool: Pool, path: Path) -> None:
    """As :func:`check_spec`; a run that began without action masks goes on without them.

    Raises:
        CheckpointError: It was trained for other observations or actions.
    """
    check_spec(checkpoint, pool.policies, path)
    for name, policy in pool.policies.items():
        if policy.was_unmasked(checkpoint.fingerprints[name]):
            pool.ignore_masks(name)


class CheckpointStore:
    """The checkpoints of one run: the newest ones, the best one, and those to keep for ever."""

    def __init__(self, folder: Path, keep: int) -> None:
        self.folder = folder
        self._keep = keep

    def paths(self) -> list[Path]:
        """Return checkpoint folders, oldest first, without those to keep for ever."""
        return self._numbered("step")

    def kept(self) -> list[Path]:
        """Return the checkpoints to keep for ever, oldest first."""
        return self._numbered("update")

    def write(self, checkpoint: Checkpoint) -> Path:
        """Save a checkpoint, then drop those that are neither new nor best."""
        path = self.folder / f"step-{checkpoint.agent_steps:012d}"
        if self._is_written(path):  # nothing was learnt since then
            _write_modes(path, checkpoint)
            return path
        write_checkpoint(path, checkpoint)
        with disk_errors(f"the checkpoints in {self.folder}"):
            self._prune(path)
        return path

    def keep(self, checkpoint: Checkpoint, updates: int) -> Path:
        """Save a checkpoint that is never dropped, without replay buffers."""
        path = self.folder / f"update-{updates:012d}"
        if not self._is_written(path):
            learners = {
                name: replace(learner, replay={}) for name, learner in checkpoint.learners.items()
            }
            write_checkpoint(path, replace(checkpoint, learners=learners))
        return path

    def newest(self) -> tuple[Path, Checkpoint]:
        """Return the newest checkpoint that can be loaded, without replay buffers, and its path.

        Renames nothing.

        Raises:
            CheckpointError: There is none.
        """
        return self._load(lambda path, checkpoint: (path, checkpoint), is_resumed=False)

    def resume(self, take: Callable[[Path, Checkpoint], Taken]) -> Taken:
        """Return what ``take`` makes of the newest checkpoint that can be loaded.

        Newer ones are renamed, so that they neither count as checkpoints nor take the place of
        those to come.

        Args:
            take: Called with a checkpoint, replay buffers included, and where it is. What it
                raises under :func:`checkpoint_errors` has the next older one tried.

        Raises:
            CheckpointError: There is none, or ``take`` refuses one; nothing was renamed.
            RunError: One could not be renamed.
        """
        return self._load(take, is_resumed=True)

    def _load(self, take: Callable[[Path, Checkpoint], Taken], *, is_resumed: bool) -> Taken:
        tried: set[Path] = set()
        # A run that goes on may drop all that were there, and write others, while they are read.
        while untried := [p for p in [*self.kept(), *self.paths()] if p not in tried]:
            for path in reversed(untried):
                tried.add(path)
                try:
                    taken = take(path, read_checkpoint(path, has_replay=is_resumed))
                except CorruptError as error:
                    log.warning("%s; trying an older one", error.message)
                    continue
                except _MissingError:
                    continue
                for unloadable in sorted(tried - {path}) if is_resumed else ():
                    self._set_aside(unloadable)
                return taken
        raise CheckpointError(
            f"no checkpoint in {self.folder} can be loaded", "start a new run without --resume"
        )

    def best(self) -> Path | None:
        """Return the checkpoint with the highest mean return, None before any has one."""
        scores = [(score, path) for path in self.paths() if (score := _mean_return(path))]
        return max(scores)[1] if scores else None

    def clean(self) -> None:
        """Remove what a killed run left half written."""
        for path in self.folder.glob(f"{TEMPORARY}*"):
            shutil.rmtree(path, ignore_errors=True)

    def _numbered(self, kind: str) -> list[Path]:
        """Return what is called ``KIND-NUMBER``, the lowest number first."""
        paths = self.folder.glob(f"{kind}-*")
        numbered = [(int(p.name[len(kind) + 1 :]), p) for p in paths if NUMBERED.fullmatch(p.name)]
        return [path for _, path in sorted(numbered)]

    def _is_written(self, path: Path) -> bool:
        """Return whether ``path`` is a checkpoint that can be loaded; set aside one that cannot."""
        if not os.path.lexists(path):
            return False
        try:
            read_checkpoint(path, has_replay=True)
        except CheckpointError as error:
            log.warning("%s", error.message)
            self._set_aside(path)
            return False
        return True

    def _set_aside(self, path: Path) -> None:
        aside, attempt = path.with_name(f"unloadable-{path.name}"), 1
        while os.path.lexists(aside):
            attempt += 1
            aside = path.with_name(f"unloadable-{path.name}-{attempt}")
        with disk_errors(str(aside)):
            if os.path.lexists(path):
                path.rename(aside)
                log.warning("%s was renamed to %s and no longer counts", path, aside.name)

    def _prune(self, written: Path) -> None:
        best = self.best()
        for path in self.paths()[: -self._keep]:
            if path not in (best, written):
                # Hidden first, so that one half removed is never taken for a checkpoint.
                doomed = path.rename(path.with_name(f"{TEMPORARY}{path.name}"))
                shutil.rmtree(doomed, ignore_errors=True)
        for path in self.paths()[:-1]:
            (path / REPLAY).unlink(missing_ok=True)  # large, and only the newest is resumed


def _write_modes(path: Path, checkpoint: Checkpoint) -> None:
    """Note who learns now in a checkpoint that was written before."""
    state = _read_state(path)
    if state["run"].get("seats") != checkpoint.run.get("seats"):
        state["run"]["seats"] = checkpoint.run["seats"]
        state.pop("state_sha256", None)
        with disk_errors(f"the checkpoint {path}"):
            write_atomically(path / STATE, _seal(state))


def _mean_return(path: Path) -> tuple[float] | None:
    try:
        value = _read_state(path).get("mean_return")
    except CheckpointError:
        return None
    return None if value is None else (float(value),)


def _seal(state: dict[str, Any]) -> bytes:
    """Return the text of ``state.json``, which begins with the hash of the rest."""
    rest = json.dumps(state).encode()[1:]
    return b'{"state_sha256": "%s", ' % hashlib.sha256(rest).hexdigest().encode() + rest


def _read_state(path: Path) -> dict[str, Any]:
    if not path.is_dir():
        if os.path.lexists(path):
            raise _corrupt(path, "it is no folder")
        raise _MissingError(f"there is no checkpoint {path}", "check the path of the run")
    try:
        data = read_plain_file(path / STATE)
        state: Any = parse_json(data)
    except (OSError, ValueError) as error:
        raise _corrupt(path, f"{STATE}: {error}") from None
    if not isinstance(state, dict):
        raise _corrupt(path, f"{STATE} is not an object")
    seal = SEAL.match(data)  # which files of earlier versions have not
    if seal and hashlib.sha256(data[seal.end() :]).hexdigest().encode() != seal[1]:
        raise _corrupt(path, f"{STATE} has changed since it was saved")
    values = cast(dict[str, Any], state)
    if values.get("format") != FORMAT:
        raise CorruptError(
            f"{path} has format {values.get('format')}, this version reads {FORMAT}",
            "use the version of ludus that wrote it",
        )
    is_sound = all(isinstance(values.get(name), kind) for name, kind in FIELDS.items())
    mean_return = values.get("mean_return")
    if not is_sound or not (mean_return is None or isinstance(mean_return, int | float)):
        raise _corrupt(path, f"{STATE} lacks a field, or one has the wrong type")
    return values


def _corrupt(path: Path, reason: str) -> CheckpointError:
    return CorruptError(
        f"the checkpoint {path} is corrupt: {reason}",
        "delete that folder; resuming uses the newest checkpoint that can be loaded",
    )
