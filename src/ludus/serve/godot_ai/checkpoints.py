"""Checkpoints of agents: under each name a run folder, as ``ludus train`` makes them.

::

    AIServerCommFiles/ludus/
        .gdignore               the editor leaves this folder alone
        hero/                   the newest two of agent hero; `ludus export` takes this folder
            config.json
            checkpoints/step-000000000100/
        hero_1000/              what the game asked to keep under this name
        hero.old-1/             what hero was before it started over; never removed
"""

from __future__ import annotations

import logging
import shutil
from pathlib import Path

from ludus.disk import disk_errors
from ludus.errors import CheckpointError
from ludus.runs.checkpoint import (
    Checkpoint,
    CheckpointStore,
    check_spec,
    checkpoint_errors,
    write_checkpoint,
)
from ludus.runs.run_folder import RunFolder
from ludus.serve.godot_ai.agent import Agent
from ludus.settings.plain import to_plain
from ludus.settings.train_config import TrainConfig

__all__ = ["AgentCheckpoints"]

FOLDER = "ludus"
KEEP = 2

log = logging.getLogger(__name__)


class AgentCheckpoints:
    """The checkpoints of all agents of a project.

    Args:
        folder: Where bulk data of the project lies.
        seed: Of the server, noted in each run folder.
    """

    def __init__(self, folder: Path, seed: int) -> None:
        self.folder = folder / FOLDER
        self._seed = seed
        with disk_errors(str(self.folder)):
            self.folder.mkdir(exist_ok=True)
            (self.folder / ".gdignore").touch()

    def exists(self, name: str) -> bool:
        """Return whether there is a checkpoint of this name."""
        return bool(self._store(name).paths())

    def save(self, agent: Agent, *, goes_on: bool) -> None:
        """Write a checkpoint under the agent's name; it is whole before an older one goes.

        Args:
            agent: What to save.
            goes_on: Whether it has come from the checkpoints that are there; otherwise those are
                kept under another name.

        Raises:
            RunError: The disk is full, or the folder may not be written to.
        """
        folder = RunFolder(self.folder / agent.spec.name)
        if not goes_on and folder.path.exists():
            self._put_aside(folder.path)
        self._write(agent, folder)
        self._prune(folder, KEEP)

    def save_as(self, agent: Agent, name: str) -> None:
        """Write a checkpoint under ``name`` in place of what is there; errors as :meth:`save`."""
        folder = RunFolder(self.folder / name)
        self._write(agent, folder)
        for path in folder.checkpoints().paths():
            if path != _path(agent, folder):
                _remove(path)

    def load(self, agent: Agent, name: str) -> None:
        """Give a new agent what was saved under ``name``.

        Raises:
            CheckpointError: None can be loaded, or it is of another agent; ``agent`` is useless
                then.
        """

        def take(path: Path, checkpoint: Checkpoint) -> None:
            if len(checkpoint.learners) != 1:
                raise CheckpointError(f"{path} has {len(checkpoint.learners)} agents, expected one")
            (saved,) = checkpoint.learners
            with checkpoint_errors(path):
                check_spec(checkpoint, {saved: agent.spec}, path)
                agent.sac.load_state(checkpoint.learners[saved])
                agent.num_steps = int(checkpoint.run["gradient_steps"])
            agent.num_transitions = checkpoint.agent_steps

        self._store(name).resume(take)

    def _store(self, name: str) -> CheckpointStore:
        return RunFolder(self.folder / name).checkpoints()

    def _write(self, agent: Agent, folder: RunFolder) -> None:
        config = _run_config(agent, self.folder.parent.parent, self._seed)
        with disk_errors(str(folder.path)):
            folder.path.mkdir(exist_ok=True)
        folder.write_config(config)
        path = _path(agent, folder)
        before = path.with_name(f".before-{path.name}")
        with disk_errors(str(path)):
            shutil.rmtree(before, ignore_errors=True)
            if path.exists():  # corrupt, or of an agent that was replaced
                path.rename(before)
        write_checkpoint(path, _checkpoint(agent, config))
        shutil.rmtree(before, ignore_errors=True)

    def _prune(self, folder: RunFolder, keep: int) -> None:
        for path in folder.checkpoints().paths()[:-keep]:
            _remove(path)

    def _put_aside(self, path: Path) -> None:
        attempt = 1
        while (aside := path.with_name(f"{path.name}.old-{attempt}")).exists():
            attempt += 1
        log.warning("%s: what was saved before is kept in %s", path.name, aside)
        with disk_errors(str(aside)):
            path.rename(aside)


def _path(agent: Agent, folder: RunFolder) -> Path:
    return folder.checkpoints().folder / f"step-{agent.num_steps:012d}"


def _remove(path: Path) -> None:
    """Remove a checkpoint; hidden first, so that one half removed is never taken for one."""
    with disk_errors(str(path)):
        doomed = path.rename(path.with_name(f".removed-{path.name}"))
    shutil.rmtree(doomed, ignore_errors=True)


def _run_config(agent: Agent, project: Path, seed: int) -> TrainConfig:
    settings = agent.settings.config()
    return TrainConfig(target=str(project), seed=seed, policies={agent.spec.name: settings})


def _checkpoint(agent: Agent, config: TrainConfig) -> Checkpoint:
    return Checkpoint(
        agent_steps=agent.num_transitions,
        mean_return=None,
        learners={agent.spec.name: agent.sac.state()},
        specs={agent.spec.name: agent.spec.to_json()},
        fingerprints={agent.spec.name: agent.spec.fingerprint()},
        config=to_plain(config),
        run={"gradient_steps": agent.num_steps},
    )
