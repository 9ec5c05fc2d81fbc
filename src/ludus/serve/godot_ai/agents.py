"""All agents of a project, and when they are saved."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

import torch

from ludus.errors import CheckpointError, DivergenceError, LudusError
from ludus.export.convert import to_model
from ludus.export.godot_ai_file import read_godot_ai
from ludus.model.json_file import write_model
from ludus.networks.tensors import to_numbers
from ludus.serve.godot_ai.agent import Agent, AgentSettings
from ludus.serve.godot_ai.checkpoints import AgentCheckpoints
from ludus.serve.godot_ai.project_files import ProjectFiles

__all__ = ["Agents"]

log = logging.getLogger(__name__)

GODOT_AI_FOLDER = "checkpoints"
"""Where godot-ai's own server saves, in the project."""
ACTOR = "actor."
GODOT_AI_ACTOR = "network.network."
"""What parameters of the actor are called here, and in a policy file of godot-ai."""


class Agents:
    """Agents by name.

    Args:
        files: Of the project.
        seed: Of networks and sampling.
        device: Where to compute.
    """

    def __init__(self, files: ProjectFiles, seed: int, device: torch.device) -> None:
        self._files = files
        self._seed = seed
        self._device = device
        self._checkpoints = AgentCheckpoints(files.folder, seed)
        self._agents: dict[str, Agent] = {}
        self._saved_steps: dict[str, int] = {}
        self._began_with: dict[str, Path] = {}

    @property
    def lock(self) -> Path:
        """File that only one server may hold."""
        return self._checkpoints.folder / ".lock"

    @property
    def by_name(self) -> Mapping[str, Agent]:
        """All agents."""
        return MappingProxyType(self._agents)

    def create(self, settings: AgentSettings) -> None:
        """Make an agent; one that is there with equal settings stays, with all it has learnt.

        Raises:
            ConfigError: A setting is out of range.
            RunError: The agent that was there cannot be saved.
        """
        before = self._agents.get(settings.name)
        if before is not None and before.settings == settings:
            return
        if before is not None:
            log.warning("agent %s starts over with other settings", settings.name)
            self._save_unsaved(before)
        self._agents[settings.name] = Agent(settings, self._seed, self._device)
        log.info("Agent named %s initialized. Replay Capacity: %d", settings.name,
                 settings.replay_capacity)  # fmt: skip
        self._saved_steps.pop(settings.name, None)
        self._began_with.pop(settings.name, None)

    def load(self, name: str) -> bool:
        """Go on from the newest checkpoint; return whether there is one.

        Where Ludus has none, that of godot-ai's own server is taken, ``checkpoints/NAME.pt``. An
        agent that has more to it than the checkpoint stays as it is.

        Raises:
            CheckpointError: It cannot be loaded, or was saved with other settings.
        """
        agent = self._agents[name]
        theirs = self._files.root / GODOT_AI_FOLDER / f"{name}.pt"
        has_own = self._checkpoints.exists(name)
        if agent.num_transitions or agent.num_steps:
            log.info("%s: goes on from %d gradient steps", name, agent.num_steps)
            return True
        if not has_own and not theirs.is_file():
            log.info("Checkpoint not loaded for: %s (there is none)", name)
            return False
        if not has_own:
            self._agents[name] = self._loaded_from(theirs, agent.settings)
            log.info("Checkpoint loaded for %s: %s, which godot-ai wrote", name, theirs)
            return True
        if theirs.is_file():
            log.info("%s: %s is left alone, as a later checkpoint is there", name, theirs)
        self._agents[name] = self._loaded(agent.settings)
        steps = self._agents[name].num_steps
        log.info("Checkpoint loaded for %s: %d gradient steps", name, steps)
        return True

    def learn(self, name: str, num_steps: int, is_stopping: Callable[[], bool]) -> dict[str, float]:
        """Let an agent learn; return metrics, none without transitions.

        Raises:
            DivergenceError: A loss became NaN or infinite. The agent is what it was at the last
                checkpoint, and has forgotten its transitions.
        """
        agent = self._agents[name]
        if not agent.num_replays:
            log.warning("%s: nothing to learn from yet; were its replays submitted?", name)
            return {}
        try:
            return agent.learn(num_steps, is_stopping)
        except DivergenceError as error:
            self._agents[name] = self._recovered(agent)
            raise DivergenceError(
                f"{error.message}; {name} goes on from its last checkpoint", error.hint
            ) from None

    def save(self, name: str, also: str) -> None:
        """Write a checkpoint, and one more under the name ``also``.

        Raises:
            RunError: The disk is full, or the folder may not be written to.
        """
        agent = self._agents[name]
        if agent.num_steps == 0:
            return
        if agent.num_steps != self._saved_steps.get(name):
            self._checkpoints.save(agent, goes_on=name in self._saved_steps)
            self._saved_steps[name] = agent.num_steps
        if also != name:
            self._checkpoints.save_as(agent, also)

    def save_all(self) -> None:
        """Write a checkpoint of every agent that has learnt since its last one."""
        for agent in self._agents.values():
            self._save_unsaved(agent)

    def write_policy(self, name: str) -> list[str]:
        """Write the policy for use in the game, both as godot-ai and as Ludus read it.

        Returns:
            Paths in the project.

        Raises:
            RunError, PolicyFileError: They cannot be written.
        """
        agent = self._agents[name]
        parameters = {
            key.replace(ACTOR, GODOT_AI_ACTOR): to_numbers(value.detach().cpu())
            for key, value in agent.sac.policy.named_parameters()
        }
        path = self._files.write(f"{name}_policy.json", parameters)
        own = f"{path.removesuffix(f'{name}_policy.json')}{name}.ludus.json"
        write_model(self._files.find(own), to_model(agent.sac.policy, agent.spec))
        return [path, own]

    def _save_unsaved(self, agent: Agent) -> None:
        name = agent.settings.name
        if agent.num_steps > self._saved_steps.get(name, 0):
            self.save(name, name)

    def _loaded(self, settings: AgentSettings) -> Agent:
        """Return a new agent with what was saved; the one that is there is not touched."""
        agent = Agent(settings, self._seed, self._device)
        try:
            self._checkpoints.load(agent, settings.name)
        except CheckpointError as error:
            raise CheckpointError(
                f"{settings.name} starts over: {error.message}",
                f"{error.hint}; what was saved is kept under another name once it learns",
            ) from None
        self._saved_steps[settings.name] = agent.num_steps
        return agent

    def _loaded_from(self, path: Path, settings: AgentSettings) -> Agent:
        """Return a new agent with the networks that godot-ai's own server has saved."""
        agent = Agent(settings, self._seed, self._device)
        try:
            agent.take_networks(read_godot_ai(path), path)
        except CheckpointError as error:
            raise CheckpointError(
                f"{settings.name} starts over: {error.message}", error.hint
            ) from None
        self._began_with[settings.name] = path
        return agent

    def _recovered(self, agent: Agent) -> Agent:
        name = agent.settings.name
        try:
            if name in self._saved_steps:
                return self._loaded(agent.settings)
            if name in self._began_with:
                return self._loaded_from(self._began_with[name], agent.settings)
        except LudusError as error:
            log.error("%s", error)
        self._saved_steps.pop(name, None)
        return Agent(agent.settings, self._seed, self._device)
