"""Draw the parameters of worlds whenever their episodes begin."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ludus.settings.world_parameters import Parameter, Sampler, Value, check_parameters
from ludus.spec import Spec
from ludus.spec.batch import Batches
from ludus.wire.reset import ResetAction, ResetRequest

__all__ = ["Sums", "WorldParameters", "add_sums"]

Sums = dict[str, tuple[int, float]]
"""How many numbers were drawn, and their sum, by name of the parameter."""

SALT = 0x6C65_7373
"""Keeps draws apart from what a game makes of the same seed."""


class WorldParameters:
    """What :class:`ludus.pool.EnginePool` gives the worlds of a game as parameters.

    A world draws in every reset, and when all of its agents begin an episode in the same step. The
    draws of a world are a function of its seed and of how often it has drawn since that seed came
    or, if later, this object was made.

    Args:
        parameters: By name; a value that stays, or how it is drawn.
        spec: Of each engine.
        seeds: Seed of each world of the pool, until a reset brings another.

    Raises:
        ConfigError: A sampler names no distribution, or several.
    """

    def __init__(
        self,
        parameters: Mapping[str, Parameter],
        spec: Spec,
        seeds: Iterable[int],
    ) -> None:
        check_parameters("randomise", parameters)
        self._parameters = parameters
        self._spec = spec
        self._streams = [_open_stream(seed) for seed in seeds]
        self._active: dict[tuple[str, int], NDArray[np.bool_]] = {}
        self._sums: Sums = {}

    def complete(self, request: ResetRequest) -> ResetRequest:
        """Return a reset of all engines with draws for the worlds that it resets.

        What the request gives by itself wins over draws.
        """
        completed: list[Mapping[str, Any] | None] = [None] * len(request.seeds)
        for world, action in enumerate(request.actions):
            if action == ResetAction.LEAVE:
                continue
            if action == ResetAction.SEED:
                self._streams[world] = _open_stream(int(request.seeds[world]))
            given = request.parameters
            own = given if given is None or isinstance(given, Mapping) else given[world]
            completed[world] = {**self.draw(world), **(own or {})}
        return replace(request, parameters=completed)

    def request_beginnings(self, begun: NDArray[np.bool_], first_world: int) -> ResetRequest | None:
        """Return a reset of one engine in which the worlds that have begun draw.

        Args:
            begun: ``bool[worlds of the engine]``, from :meth:`find_beginnings`.
            first_world: Index of the engine's first world in the pool.

        Returns:
            None if there is nothing to draw.
        """
        if not begun.any() or not any(isinstance(it, Sampler) for it in self._parameters.values()):
            return None
        actions = np.where(begun, ResetAction.NEXT_EPISODE, ResetAction.LEAVE).astype(np.uint8)
        drawn = [self.draw(first_world + i) if begun[i] else None for i in range(len(begun))]
        return ResetRequest(np.zeros(len(begun), np.uint64), actions, drawn)

    def find_beginnings(self, engine: int, batches: Batches) -> NDArray[np.bool_]:
        """Return ``bool[worlds]``: where all agents begin an episode in the step of ``batches``."""
        begins, goes_on = np.zeros((2, self._spec.num_worlds), np.bool_)
        for policy in self._spec.policies:
            batch, before = batches[policy.name], self._active[policy.name, engine]
            shape = (-1, policy.agents_per_world)
            ended = (batch.terminated | batch.truncated).reshape(shape)
            begins |= ended.any(1)
            acting = (before & batch.active).reshape(shape)
            goes_on |= (acting & ~ended).any(1)
        return begins & ~goes_on

    def note(self, engine: int, batches: Batches) -> None:
        """Note who acts on the last answer of an engine."""
        for name, batch in batches.items():
            self._active[name, engine] = batch.active.copy()

    def draw(self, world: int) -> dict[str, Value]:
        """Draw the parameters of a world."""
        drawn = {name: _draw(of, self._streams[world]) for name, of in self._parameters.items()}
        for name, value in drawn.items():
            if isinstance(value, int | float) and not isinstance(value, bool):
                count, total = self._sums.get(name, (0, 0.0))
                self._sums[name] = (count + 1, total + value)
        return drawn

    def take_sums(self) -> Sums:
        """Return count and sum of each number that was drawn since the last time."""
        sums, self._sums = self._sums, {}
        return sums


def add_sums(first: Sums, second: Sums) -> Sums:
    """Return the sums of both."""
    added = dict(first)
    for name, (count, total) in second.items():
        own_count, own_total = added.get(name, (0, 0.0))
        added[name] = (own_count + count, own_total + total)
    return added


def _open_stream(seed: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence((seed, SALT)))


def _draw(parameter: Parameter, stream: np.random.Generator) -> Value:
    if not isinstance(parameter, Sampler):
        return parameter
    if parameter.uniform is not None:
        low, high = parameter.uniform
        return float(stream.uniform(low, high))
    if parameter.normal is not None:
        mean, deviation = parameter.normal
        return float(stream.normal(mean, deviation))
    choice: Sequence[Value] = parameter.choice or ()
    return choice[int(stream.integers(len(choice)))]
