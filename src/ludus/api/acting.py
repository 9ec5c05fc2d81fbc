"""``ludus.load_policy``: a trained policy that acts on observations, without its game."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol, cast

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ludus.arguments import check_arguments
from ludus.errors import ArgumentError, ConfigError, UsageError
from ludus.libraries.seeds import check_seed
from ludus.model import ModelRunner, read_model
from ludus.model.frame_stack import FrameStack
from ludus.networks.own_network import MakeNetwork
from ludus.spec import ObservationEntry, PolicySpec
from ludus.spec.batch import ActionBatch
from ludus.spec.spaces import (
    FLAT_ENTRY,
    action_space,
    actions_of,
    is_flat,
    observation_space,
)
from ludus.target import find_run

__all__ = ["LoadedPolicy", "load_policy"]

ONNX = ".onnx"


class Runner(Protocol):
    """Computes actions; :class:`~ludus.model.ModelRunner` is one.

    Attributes:
        num_frames: How many observations it takes together.
    """

    num_frames: int

    def act(
        self,
        observation: Mapping[str, NDArray[Any]],
        action_mask: NDArray[np.bool_] | None = None,
        memory: NDArray[np.float32] | None = None,
        generator: np.random.Generator | None = None,
    ) -> tuple[ActionBatch, NDArray[np.float32] | None]:
        """Return the actions of ``n`` agents, and their next memory, None without one."""
        ...


class LoadedPolicy:
    """A trained policy.

    Attributes:
        name: Name of the policy.
        spec: What it observes and does.
        observation_space: Of one agent, as in :func:`ludus.make`.
        action_space: Of one agent.
    """

    def __init__(self, spec: PolicySpec, runner: Runner, seed: int) -> None:
        self.name = spec.name
        self.spec = spec
        self.observation_space: spaces.Space[Any] = observation_space(spec)
        self.action_space: spaces.Space[Any] = action_space(spec)
        self._runner = runner
        self._generator = np.random.default_rng(seed)
        self._memory: NDArray[np.float32] | None = None
        self._frames: FrameStack | None = None
        self._is_first = np.ones(0, np.bool_)

    def act(self, observation: Any, *, action_mask: Any = None, stochastic: bool = False) -> Any:
        """Return the action for an observation, or the actions for a batch of ``n``.

        A policy with a memory, or one that sees several frames, goes on from its last call. Call
        :meth:`forget` where an episode begins.

        Args:
            observation: Of ``observation_space``, or ``n`` of them in arrays with one more axis in
                front; a dictionary where the space is one.
            action_mask: ``bool[sum(nvec)]`` or ``bool[n, sum(nvec)]``, True = allowed; None allows
                everything.
            stochastic: Draw actions as in training instead of taking the most probable ones.

        Returns:
            An action of ``action_space``; for a batch ``n`` of them in arrays.

        Raises:
            ArgumentError: What should be a dictionary, or an array of numbers, is something else.
            UsageError: An entry is missing or has another shape, or a policy with a memory gets a
                batch of another size than before.
        """
        entries, is_single = self._entries(observation)
        num = len(next(iter(entries.values())))
        if len(self._is_first) != num:
            if self._memory is not None or self._frames is not None:
                raise UsageError(
                    f"policy {self.name} remembers {len(self._is_first)} agents, but {num} act now",
                    "call policy.forget() before a batch of another size",
                )
            self._is_first = np.ones(num, np.bool_)
        if self._runner.num_frames > 1:
            if self._frames is None:
                self._frames = FrameStack(self.spec.observation, self._runner.num_frames, num)
            entries = self._frames.push(entries, self._is_first)
            self._is_first[...] = False
        mask = None if action_mask is None else np.asarray(action_mask, np.bool_).reshape(num, -1)
        generator = self._generator if stochastic else None
        batch, self._memory = self._runner.act(entries, mask, self._memory, generator)
        actions = actions_of(self.spec, batch)
        if not is_single:
            return actions
        if isinstance(actions, Mapping):
            parts = cast(Mapping[str, NDArray[Any]], actions)
            return {name: values[0] for name, values in parts.items()}
        return actions[0]

    def forget(self, ended: Any = None) -> None:
        """Forget what was seen where episodes have ended.

        Args:
            ended: ``bool[n]``, such as ``terminated | truncated``; None clears all.
        """
        if ended is None:
            self._memory = self._frames = None
            self._is_first = np.ones(0, np.bool_)
            return
        has_ended = np.asarray(ended, np.bool_)
        if self._memory is not None:
            self._memory[has_ended] = 0.0
        if self._frames is not None:
            self._is_first[has_ended] = True

    def _entries(self, observation: Any) -> tuple[dict[str, NDArray[Any]], bool]:
        """Return a batch of every entry, and whether there was only one observation."""
        given = {FLAT_ENTRY: observation} if is_flat(self.spec) else observation
        if not isinstance(given, Mapping):
            names = ", ".join(entry.name for entry in self.spec.observation)
            raise ArgumentError(f"policy {self.name} observes a dictionary with {names}")
        named = cast(Mapping[str, Any], given)
        entries: dict[str, NDArray[Any]] = {}
        is_single = False
        for entry in self.spec.observation:
            if entry.name not in named:
                raise UsageError(f'policy {self.name}: the observation lacks "{entry.name}"')
            array = self._array(entry, named[entry.name])
            is_single = array.shape == entry.shape
            array = array[None] if is_single else array
            if array.shape[1:] != entry.shape or not len(array):
                raise UsageError(
                    f'policy {self.name}: "{entry.name}" has shape {list(array.shape)}, expected '
                    f"{list(entry.shape)}, or a batch of those"
                )
            entries[entry.name] = array
        return entries, is_single

    def _array(self, entry: ObservationEntry, value: Any) -> NDArray[Any]:
        try:
            return np.asarray(value, entry.numpy_dtype)
        except (TypeError, ValueError):
            raise ArgumentError(
                f'policy {self.name}: "{entry.name}" is a {type(value).__name__} that is not an '
                f"array of numbers, expected one of shape {list(entry.shape)}, or a batch of those",
                "policy.observation_space.sample() shows the form",
            ) from None


@check_arguments
def load_policy(
    path: str | Path,
    policy: str | None = None,
    *,
    checkpoint: str = "newest",
    networks: Mapping[str, MakeNetwork] | None = None,
    seed: int = 0,
) -> LoadedPolicy:
    """Load a trained policy.

    >>> policy = ludus.load_policy("runs/cartpole-…")               # doctest: +SKIP
    >>> action = policy.act(observation)                            # doctest: +SKIP

    Args:
        path: A run folder, one of its checkpoints, a ``.ludus.json`` file, or an ``.onnx`` file
            that Ludus has exported.
        policy: Name of the policy, where a run has several.
        checkpoint: Of a run: ``"newest"``, ``"best"`` (the highest mean return), or one of its own.
        networks: What the run was trained with in the place of Ludus's networks.
        seed: Of actions that are drawn.

    Raises:
        ArgumentError: An argument has the wrong type.
        ConfigError: The run has several policies and none was named, or no such policy.
        CheckpointError: There is no such run or checkpoint.
        PolicyFileError: The file cannot be read, or is no policy.
    """
    path = Path(path)
    check_seed(seed)
    if find_run(path) is None and not path.is_dir():
        spec, runner = _read_onnx(path) if path.suffix == ONNX else _read_json(path)
        if policy not in {None, spec.name}:
            raise ConfigError(f"{path} holds the policy {spec.name}, not {policy}")
        return LoadedPolicy(spec, runner, seed)
    from ludus.api.runners import NetworkRunner
    from ludus.export.trained import load_trained

    found = load_trained(path, checkpoint, policy, networks)
    if len(found) > 1:
        names = [one.spec.name for one in found]
        raise ConfigError(
            f"{path} has several policies: {', '.join(names)}",
            f'name one: ludus.load_policy(…, "{names[0]}")',
        )
    return LoadedPolicy(found[0].spec, NetworkRunner(found[0].policy), seed)


def _read_json(path: Path) -> tuple[PolicySpec, Runner]:
    model = read_model(path)
    return model.spec, ModelRunner(model)


def _read_onnx(path: Path) -> tuple[PolicySpec, Runner]:
    from ludus.api.runners import OnnxRunner

    runner = OnnxRunner(path)
    return runner.spec, runner
