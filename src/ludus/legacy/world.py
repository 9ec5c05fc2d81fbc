"""The agents of one policy of a legacy game: batch, episodes, same-step autoreset."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from ludus.errors import ActionError, ConfigError, GameError, ProtocolError
from ludus.legacy.game import Declaration, Outcome
from ludus.spec import AgentSpec, PolicySpec, Spec
from ludus.spec.batch import ActionBatch, Batch
from ludus.spec.batch_rows import actions_reader, clear_outcome, stacked, write_finals
from ludus.spec.finite import all_finite_fast
from ludus.spec.gymnasium_spec import read_action, read_observation

__all__ = ["LegacyWorld", "num_agents_of", "read_declarations"]

_MISFITS = (ValueError, TypeError, KeyError, AttributeError)


class LegacyWorld:
    """Turns what a game says of one policy into batches (PROTOCOL.md §7, "Meaning").

    Args:
        policy: The policy.
        declaration: Where it comes from.
        num_in_all: Agents of the game, also those of other policies.
    """

    def __init__(self, policy: PolicySpec, declaration: Declaration, num_in_all: int) -> None:
        self._name = policy.name
        self._rows = _rows_of(declaration)
        self._num_in_all = num_in_all
        self._is_restarting = declaration.is_restarting
        self.batch = Batch.allocate(policy, policy.num_agents)
        self._num_agents = policy.num_agents
        self._max_episode_steps = policy.max_episode_steps
        self._discrete_shape = (policy.num_agents, policy.num_discrete)
        self._continuous_shape = (policy.num_agents, policy.continuous_size)
        self._to_actions = actions_reader(declaration.action_space)
        self._read = declaration.read or partial(stacked, self.batch)
        self._is_active = [False] * policy.num_agents
        self._num_steps = [0] * policy.num_agents

    def begin(self, observations: Sequence[Any]) -> None:
        """Begin an episode with its first observations; reward and ends stay as they are.

        Raises:
            GameError: An observation does not fit the spec.
            ProtocolError: There is not one for each agent.
        """
        self._check_count(observations)
        self._write(range(self._num_agents), observations)
        self._is_active = [True] * self._num_agents
        self._num_steps = [0] * self._num_agents
        self.batch.active[:] = True

    def clear_outcome(self) -> None:
        """Set reward and ends to nothing, as in the answer to a reset and before one to a step."""
        clear_outcome(self.batch)

    def write_actions(self, actions: Mapping[str, ActionBatch], into: list[Any]) -> None:
        """Put an element of the action space at each agent's place; None for who has ended.

        Raises:
            ActionError: There are none of the policy, they have the wrong shape, or one is not
                finite.
        """
        own = actions.get(self._name)
        if own is None:
            raise ActionError(f"no actions for policy {self._name}")
        self._check_shape("discrete", own.discrete.shape, self._discrete_shape)
        self._check_shape("continuous", own.continuous.shape, self._continuous_shape)
        if not (all_finite_fast((own.continuous,)) or np.isfinite(own.continuous).all()):
            row = int(np.argwhere(~np.isfinite(own.continuous))[0, 0])
            raise ActionError(
                f"{self._name}.continuous: the action of agent {row} is not finite: "
                f"{own.continuous[row].tolist()}"
            )
        elements = self._to_actions(own.discrete, own.continuous)
        for place, is_active, element in zip(self._rows, self._is_active, elements, strict=True):
            into[place] = element if is_active else None

    def take(self, outcome: Outcome) -> bool:
        """Write down what a step led to, after :meth:`clear_outcome`.

        Returns:
            Whether all agents have ended and wait, so that :meth:`begin` is next.

        Raises:
            GameError: Something does not fit the spec.
            ProtocolError: There is not one of everything for each agent.
        """
        for part in outcome:
            if part is not None:
                self._check_count(part)
        finals = self._note_ends(outcome)
        if self._is_restarting:
            self._restart(outcome.active)
        acting = [row for row, is_active in enumerate(self._is_active) if is_active]
        self._write(acting, outcome.observations, finals)
        return not (self._is_restarting or any(self._is_active))

    def _note_ends(self, outcome: Outcome) -> list[int]:
        """Write rewards and ends of who acted; return who ended."""
        limit, batch = self._max_episode_steps, self.batch
        finals: list[int] = []
        for row, place in enumerate(self._rows):
            if not self._is_active[row]:
                continue
            self._num_steps[row] += 1
            is_last = limit is not None and self._num_steps[row] >= limit
            batch.reward[row] = outcome.rewards[place]
            is_terminated = bool(outcome.terminated[place])
            is_truncated = not is_terminated and (is_last or bool(outcome.truncated[place]))
            if is_terminated or is_truncated:
                batch.terminated[row], batch.truncated[row] = is_terminated, is_truncated
                self._is_active[row] = batch.active[row] = False
                finals.append(row)
        return finals

    def _restart(self, active: Sequence[bool] | None) -> None:
        """Let agents whose next episode has begun by itself act again."""
        for row, place in enumerate(self._rows):
            if not self._is_active[row] and (active is None or active[place]):
                self._is_active[row] = self.batch.active[row] = True
                self._num_steps[row] = 0

    def _check_count(self, part: Sequence[Any]) -> None:
        if len(part) != self._num_in_all:
            raise ProtocolError(
                f"the game answered for {len(part)} agents, expected {self._num_in_all}",
                hint="num_agents must be what the game has",
            )

    def _check_shape(self, kind: str, shape: tuple[int, ...], expected: tuple[int, ...]) -> None:
        if shape != expected:
            raise ActionError(
                f"{self._name}.{kind}: expected actions of shape {expected}, got {shape}"
            )

    def _write(
        self, acting: Sequence[int], observations: Sequence[Any], finals: Sequence[int] = ()
    ) -> None:
        """Write what those who act observe, and the last observations of who has ended.

        Args:
            acting: Rows; those of agents that have ended and begun again are in both.
            observations: Of all agents of the game.
            finals: Rows.
        """
        rows = sorted({*acting, *finals})
        if not rows:
            return
        own = [observations[self._rows[row]] for row in rows]
        try:
            entries = self._read(own)
        except _MISFITS:  # once more one by one, to name the first that does not fit
            for row, observation in zip(rows, own, strict=True):
                try:
                    self._read([observation])
                except _MISFITS as error:
                    raise _does_not_fit(row, error) from error
            raise
        are_all = len(rows) == self._num_agents  # as a rule, and quicker to write than some
        for name, values in entries.items():
            self.batch.observation[name][slice(None) if are_all else rows] = values
        if finals:
            places = finals if are_all else np.searchsorted(rows, finals)
            write_finals(self.batch, finals, {name: of[places] for name, of in entries.items()})
            waiting = [row for row in finals if not self._is_active[row]]
            for values in self.batch.observation.values():
                values[waiting] = 0


def num_agents_of(declarations: Sequence[Declaration]) -> int:
    """Return how many agents a game has in all."""
    return sum(declaration.num_agents for declaration in declarations)


def read_declarations(declarations: Sequence[Declaration], max_episode_steps: int | None) -> Spec:
    """Return the spec of a game with one world.

    Raises:
        TargetError: A space cannot be trained.
        ConfigError: There are no agents.
    """
    first = declarations[0]
    policies = tuple(_read_policy(part, max_episode_steps) for part in declarations)
    return Spec(1, "isolated", 1, first.steps_per_second, policies, first.name)


def _read_policy(declaration: Declaration, max_episode_steps: int | None) -> PolicySpec:
    num = declaration.num_agents
    if num < 1:
        raise ConfigError(f"num_agents is {num}, expected at least 1")
    is_together = num > 1 and not declaration.is_restarting
    return PolicySpec(
        name=declaration.policy,
        observation=read_observation(declaration.observation_space),
        action=read_action(declaration.action_space),
        agents=tuple(AgentSpec(0, str(place)) for place in _rows_of(declaration)),
        agents_per_world=num,
        episode="world" if is_together else "agent",
        max_episode_steps=max_episode_steps,
    )


def _rows_of(declaration: Declaration) -> tuple[int, ...]:
    return tuple(range(declaration.num_agents)) if declaration.rows is None else declaration.rows


def _does_not_fit(row: int, error: Exception) -> GameError:
    return GameError(
        f"the observation of agent {row} does not fit observation_space: {error}",
        hint="compare what the game sends with observation_space in Python",
    )
