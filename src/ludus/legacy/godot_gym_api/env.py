"""A game for godot_gym_api as ``gymnasium.Env``, out of spaces and three functions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ludus.errors import SequenceError
from ludus.legacy.game import Declaration
from ludus.legacy.godot_gym_api.declared_game import DeclaredGame, Functions
from ludus.legacy.godot_gym_api.environment import GodotEnvironment

__all__ = ["GodotGymApiEnv"]


class GodotGymApiEnv(GodotEnvironment):
    """One game, one agent.

    The game's seed is its own affair: the wire has none. ``reset(options=…)`` configures the game
    before it begins the episode.

    Args:
        declaration: What the game takes, and what the functions make of its data.
        functions: Observation, reward, end.
        requested_observation: Whose data the game shall send; None: agent's and world's.
        settings: Arguments of :class:`GodotEnvironment`.
    """

    def __init__(
        self,
        declaration: Declaration,
        functions: Functions,
        requested_observation: Mapping[str, Any] | None = None,
        **settings: Any,
    ) -> None:
        if requested_observation is not None:
            self._requested_observation = requested_observation
        super().__init__(**settings)
        self.action_space = declaration.action_space
        self.observation_space = declaration.observation_space
        self._declared = DeclaredGame(
            self._godot_client, declaration, functions, self._requested_observation
        )
        self._needs_reset = True

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: Seeds ``np_random`` only; the game is not told.
            options: ``agent``, ``world`` and ``environment``: what to configure before.

        Raises:
            UsageError: There is another option.
            EngineError: The game failed.
        """
        super().reset(seed=seed)
        self._needs_reset = True
        (observation,) = self._declared.reset(seed, options)
        self._needs_reset = False
        return observation, {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Act once.

        Returns:
            Observation, reward, terminated, False (the wire knows no truncation), info.

        Raises:
            SequenceError: The episode has ended, or never begun: call ``reset``.
            ActionError: The action does not fit ``action_space``.
            GameError: Observation or reward are not finite, or of another shape.
            EngineError: The game failed.
        """
        if self._needs_reset:
            raise SequenceError("step outside an episode", hint="call reset() first")
        self._declared.send([action])
        outcome = self._declared.receive()
        self._needs_reset = outcome.terminated[0]
        return outcome.observations[0], outcome.rewards[0], outcome.terminated[0], False, {}

    def configure(self, configuration: Mapping[str, Any]) -> None:
        """Configure the game: ``{"agent": {…}, "world": {…}, "environment": {…}}``.

        Raises:
            ConfigError: There is another part.
            EngineError: The game failed.
        """
        self._godot_configure(configuration)
