"""The one world of a legacy game: its batch, its episodes, same-step autoreset."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ludus.errors import ActionError, ConfigError, GameError, ProtocolError
from ludus.legacy.game import Declaration, Outcome
from ludus.spec import AgentSpec, PolicySpec, Spec
from ludus.spec.batch import ActionBatch, Batch
from ludus.spec.batch_rows import action_reader, clear_outcome, write_finals, write_state
from ludus.spec.gymnasium_spec import read_action, read_observation

__all__ = ["POLICY", "LegacyWorld", "read_declaration"]

POLICY = "agent"
"""Name of the one policy; these wires know no names."""


class LegacyWorld:
    """Turns what one game says into batches (PROTOCOL.md §7, "Meaning").

    Args:
        policy: The one policy of the game.
        declaration: Where it comes from.
    """

    def __init__(self, policy: PolicySpec, declaration: Declaration) -> None:
        self.batch = Batch.allocate(policy, policy.num_agents)
        self._num_agents = policy.num_agents
        self._max_episode_steps = policy.max_episode_steps
        self._discrete_shape = (policy.num_agents, policy.num_discrete)
        self._continuous_shape = (policy.num_agents, policy.continuous_size)
        self._to_action = action_reader(declaration.action_space)
        self._is_active = [False] * policy.num_agents
        self._num_steps = 0

    def begin(self, observations: Sequence[Any]) -> None:
        """Begin an episode with its first observations; reward and ends stay as they are.

        Raises:
            GameError: An observation does not fit the spec.
            ProtocolError: There is not one for each agent.
        """
        if len(observations) != self._num_agents:
            raise _wrong_count(len(observations), self._num_agents)
        self._num_steps = 0
        for row, observation in enumerate(observations):
            self._write(row, observation)
            self._is_active[row] = True
        self.batch.active[:] = True

    def clear_outcome(self) -> None:
        """Set reward and ends to nothing, as in the answer to a reset."""
        clear_outcome(self.batch)

    def actions(self, actions: Mapping[str, ActionBatch]) -> list[Any]:
        """Return an element of the action space for each agent; None for who has ended.

        Raises:
            ActionError: There are none of the policy, or they have the wrong shape.
        """
        own = actions.get(POLICY)
        if own is None:
            raise ActionError(f"no actions for policy {POLICY}")
        _check_shape("discrete", own.discrete.shape, self._discrete_shape)
        _check_shape("continuous", own.continuous.shape, self._continuous_shape)
        return [
            self._to_action(own, row) if is_active else None
            for row, is_active in enumerate(self._is_active)
        ]

    def take(self, outcome: Outcome) -> bool:
        """Write down what a step led to.

        Returns:
            Whether all agents have ended, so that :meth:`begin` is next.

        Raises:
            GameError: Something does not fit the spec.
            ProtocolError: There is not one of everything for each agent.
        """
        for part in outcome:
            if len(part) != self._num_agents:
                raise _wrong_count(len(part), self._num_agents)
        clear_outcome(self.batch)
        self._num_steps += 1
        finals = self._note_ends(outcome)
        for row, is_active in enumerate(self._is_active):
            if is_active:
                self._write(row, outcome.observations[row])
        if finals:
            self._write_finals(finals)
        return not any(self._is_active)

    def _note_ends(self, outcome: Outcome) -> list[tuple[int, Any]]:
        """Write rewards and ends of who acted; return the last observations of who ended."""
        limit, batch = self._max_episode_steps, self.batch
        is_last = limit is not None and self._num_steps >= limit
        finals: list[tuple[int, Any]] = []
        for row, is_active in enumerate(self._is_active):
            if not is_active:
                continue
            batch.reward[row] = outcome.rewards[row]
            is_terminated = bool(outcome.terminated[row])
            is_truncated = bool(outcome.truncated[row]) or (is_last and not is_terminated)
            if is_terminated or is_truncated:
                batch.terminated[row], batch.truncated[row] = is_terminated, is_truncated
                self._is_active[row] = batch.active[row] = False
                finals.append((row, outcome.observations[row]))
        return finals

    def _write_finals(self, finals: list[tuple[int, Any]]) -> None:
        rows = [row for row, _ in finals]
        try:
            write_finals(self.batch, finals)
        except (ValueError, TypeError, KeyError) as error:
            raise _does_not_fit(rows, error) from error
        for values in self.batch.observation.values():
            values[rows] = 0

    def _write(self, row: int, observation: Any) -> None:
        try:
            write_state(self.batch, row, observation)
        except (ValueError, TypeError, KeyError) as error:
            raise _does_not_fit([row], error) from error


def read_declaration(declaration: Declaration, max_episode_steps: int | None) -> Spec:
    """Return the spec of a game with one world.

    Raises:
        TargetError: A space cannot be trained.
        ConfigError: There are no agents.
    """
    num = declaration.num_agents
    if num < 1:
        raise ConfigError(f"num_agents is {num}, expected at least 1")
    policy = PolicySpec(
        name=POLICY,
        observation=read_observation(declaration.observation_space),
        action=read_action(declaration.action_space),
        agents=tuple(AgentSpec(0, str(index)) for index in range(num)),
        agents_per_world=num,
        episode="world" if num > 1 else "agent",
        max_episode_steps=max_episode_steps,
    )
    rate = declaration.steps_per_second
    return Spec(1, "isolated", 1, rate, (policy,), declaration.name)


def _check_shape(kind: str, shape: tuple[int, ...], expected: tuple[int, ...]) -> None:
    if shape != expected:
        raise ActionError(f"{POLICY}.{kind}: expected actions of shape {expected}, got {shape}")


def _wrong_count(count: int, expected: int) -> ProtocolError:
    return ProtocolError(
        f"the game answered for {count} agents, expected {expected}",
        hint="num_agents must be what the game has",
    )


def _does_not_fit(rows: list[int], error: Exception) -> GameError:
    names = ", ".join(map(str, rows))
    return GameError(
        f"the observation of agent {names} does not fit observation_space: {error}",
        hint="compare what the game sends with observation_space in Python",
    )
