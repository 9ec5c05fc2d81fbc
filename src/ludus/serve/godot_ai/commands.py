"""The commands of godot-ai: one JSON object asks, one answers; bulk data lies in files.

An unmodified game waits for an answer and reads a certain key of it. So every refusal has that
key, too, with a value that does no harm (no path leads nowhere, no action is missing), beside
``error``, which says what was wrong.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ludus.errors import GameError, LudusError, ProtocolError
from ludus.serve.godot_ai.agent import AgentSettings
from ludus.serve.godot_ai.agents import Agents
from ludus.serve.godot_ai.fields import Fields, as_numbers, short
from ludus.serve.godot_ai.project_files import ProjectFiles
from ludus.serve.godot_ai.transitions import read_replays, unknown_agent

__all__ = ["GodotAi"]

log = logging.getLogger(__name__)

Answer = dict[str, Any]

ACTIONS = "batch_action.json"
MAX_LAYERS, MAX_WIDTH, MAX_STEPS = 64, 16_384, 10_000_000


class GodotAi:
    """Answers messages.

    Args:
        files: Of the project.
        agents: Who acts and learns.
        is_stopping: Whether training has to end, because the server does.
    """

    def __init__(
        self, files: ProjectFiles, agents: Agents, is_stopping: Callable[[], bool]
    ) -> None:
        self._files = files
        self._agents = agents
        self._is_stopping = is_stopping
        self._handlers: dict[str, Callable[[Fields], Answer]] = {
            "init": self._init,
            "load": self._load,
            "get_action": self._get_action,
            "get_batch_actions": self._get_batch_actions,
            "submit_batch_replay": self._submit_batch_replay,
            "train": self._train,
            "write_policy": self._write_policy,
        }

    def answer(self, message: Mapping[str, Any]) -> Answer:
        """Do what a message asks for; what is wrong with it is in the answer's ``error``."""
        command = message.get("command")
        handler = self._handlers.get(command) if isinstance(command, str) else None
        if handler is None:
            known = ", ".join(self._handlers)
            return refusal(ProtocolError(f"there is no command {short(command)}; known: {known}"))
        try:
            return handler(Fields(message, str(command)))
        except LudusError as error:
            return {**self._harmless(message), **refusal(error)}
        except Exception as error:  # whatever it is, the game must not wait for ever
            log.exception("a defect of ludus serve, in %s", command)
            what = f"a defect of ludus serve: {type(error).__name__}: {error}"
            return {**self._harmless(message), "error": what}

    def close(self) -> None:
        """Save what was learnt since the last checkpoint."""
        self._agents.save_all()

    # --- commands -------------------------------------------------------------------------------

    def _init(self, message: Fields) -> Answer:
        layers, widths = (0, MAX_LAYERS), (1, MAX_WIDTH)
        settings = AgentSettings(
            name=message.file_name("file_name"),
            state_size=message.integer("state_dim", 1, 1_000_000),
            action_size=message.integer("action_dim", *widths),
            batch_size=message.integer("batchsize", 1, 1_000_000),
            hidden_size=message.integer("hidden_size", *widths),
            num_actor_layers=message.integer("num_actor_layers", *layers),
            num_critic_layers=message.integer("num_critic_layers", *layers),
            replay_capacity=message.integer("replay_capacity", 1, 1_000_000_000),
        )
        self._agents.create(settings)
        return {"done": True}

    def _load(self, message: Fields) -> Answer:
        self._agents.load(self._known(message))
        return {"done": True}

    def _get_action(self, message: Fields) -> Answer:
        name = self._known(message)
        numbers = as_numbers(message.get("state"), f"{name}.state")
        states = self._states(name, numbers, "state")
        if len(states) != 1:
            raise GameError(f"{name}.state is of {len(states)} agents, expected one")
        actions = self._agents.by_name[name].act(states, is_deterministic=True)
        return {"action": actions[0].tolist()}

    def _get_batch_actions(self, message: Fields) -> Answer:
        try:
            actions, error = self._batch(message)
        except LudusError:
            # Actions of another step must not be taken for these.
            self._files.write(ACTIONS, dict.fromkeys(self._agents.by_name, ()))
            raise
        answer = {"path": self._files.write(ACTIONS, actions)}
        return {**answer, **refusal(error)} if error else answer

    def _submit_batch_replay(self, message: Fields) -> Answer:
        agents = self._agents.by_name
        submitted = read_replays(self._files.read(message.text("path")), agents)
        for name, transitions in submitted.transitions.items():
            agents[name].add(transitions)
        if submitted.first_error is None:
            return {"done": True}
        error = submitted.first_error
        counts = f"{submitted.num_wrong} of {submitted.num_rows} replays were left out"
        raise GameError(f"{counts}: {error.message}", error.hint)

    def _train(self, message: Fields) -> Answer:
        name = self._known(message)
        num_steps = message.integer("steps", 0, MAX_STEPS)
        also = message.file_name("checkpoint_name") if message.text("checkpoint_name", "") else name
        metrics = self._agents.learn(name, num_steps, self._is_stopping)
        self._agents.save(name, also)
        if metrics and message.is_true("print_logs", False):
            log.info("%s: %s", name, ", ".join(f"{k} {v:.4g}" for k, v in metrics.items()))
        return {"done": True}

    def _write_policy(self, message: Fields) -> Answer:
        name = self._known(message)
        log.info("%s: wrote %s", name, " and ".join(self._agents.write_policy(name)))
        return {"done": True}

    # --- parts of them --------------------------------------------------------------------------

    def _known(self, message: Fields) -> str:
        name = message.file_name("file_name")
        if name not in self._agents.by_name:
            raise unknown_agent(name, self._agents.by_name, message.where)
        return name

    def _batch(self, message: Fields) -> tuple[dict[str, list[float]], LudusError | None]:
        """Return the actions of all agents by name, and the first thing that is wrong."""
        path = message.text("path")
        table = message.optional("deterministic_map")
        deterministic = Fields({} if table is None else table, "deterministic_map")
        actions: dict[str, list[float]] = {}
        errors: list[LudusError] = []
        for name, numbers in self._files.read(path).all():
            try:
                is_deterministic = deterministic.is_true(name, False)
                actions[name] = self._actions(name, numbers, path, is_deterministic)
            except LudusError as error:
                errors.append(error)
                actions[name] = self._no_actions(name, numbers)
        return actions, errors[0] if errors else None

    def _actions(self, name: str, value: Any, path: str, is_deterministic: bool) -> list[float]:
        """Return the actions of all agents of one name, one behind the other."""
        if name not in self._agents.by_name:
            raise unknown_agent(name, self._agents.by_name, path)
        numbers = as_numbers(value, f"{path}: {name}")
        if not len(numbers):
            return []
        states = self._states(name, numbers, path)
        agent = self._agents.by_name[name]
        return agent.act(states, is_deterministic=is_deterministic).ravel().tolist()

    def _states(self, name: str, numbers: NDArray[np.float32], where: str) -> NDArray[np.float32]:
        """Return ``float32[n, state_size]``."""
        size = self._agents.by_name[name].settings.state_size
        if len(numbers) == 0 or len(numbers) % size:
            raise GameError(
                f"{where}: {name} has {len(numbers)} numbers, expected {size} for each agent",
                "get_state_dim must say how many numbers get_state returns",
            )
        return numbers.reshape(-1, size)

    def _no_actions(self, name: str, value: Any) -> list[float]:
        """Return zeros for as many agents as there seem to be."""
        agent = self._agents.by_name.get(name)
        if agent is None or not isinstance(value, list):
            return []
        num_agents = -(-len(cast(list[Any], value)) // agent.settings.state_size)
        return [0.0] * (num_agents * agent.settings.action_size)

    def _harmless(self, message: Mapping[str, Any]) -> Answer:
        """Return what an unmodified game reads of an answer to this message."""
        if message.get("command") == "get_batch_actions":
            return {"path": f"{self._files.folder.name}/{ACTIONS}"}
        if message.get("command") != "get_action":
            return {"done": False}
        agent = self._agents.by_name.get(str(message.get("file_name")))
        return {"action": [0.0] * (agent.settings.action_size if agent else 0)}


def refusal(error: LudusError) -> Answer:
    """Return what an answer says of an error."""
    return {"error": str(error)}
