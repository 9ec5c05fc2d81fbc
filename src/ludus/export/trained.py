"""Find the policies that a run has trained, without starting its game."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from numpy.typing import NDArray

from ludus.errors import CheckpointError, ConfigError, did_you_mean
from ludus.networks.own_network import MakeNetwork
from ludus.networks.policy import Policy
from ludus.runs.checkpoint import Checkpoint
from ludus.runs.saved import find_checkpoint, load_policies
from ludus.spec import (
    ActionComponent,
    AgentSpec,
    Bound,
    ContinuousAction,
    DiscreteAction,
    ObservationEntry,
    PolicySpec,
)

__all__ = ["TrainedPolicy", "load_trained", "spec_from_json"]

SAMPLES = "samples."
"""What recorded observations are called among the tensors of a learner."""


@dataclass(frozen=True)
class TrainedPolicy:
    """One policy of a checkpoint.

    Attributes:
        spec: What it was trained for, with one agent.
        policy: The network.
        recorded: Observations that were met in training, per entry ``dtype[n, *shape]``; empty if
            the checkpoint has none.
    """

    spec: PolicySpec
    policy: Policy
    recorded: dict[str, NDArray[Any]]


def load_trained(
    run: Path,
    choice: str = "newest",
    only: str | None = None,
    networks: Mapping[str, MakeNetwork] | None = None,
) -> list[TrainedPolicy]:
    """Return the policies of a run.

    Args:
        run: A run folder, or one of its checkpoints.
        choice: As for :func:`~ludus.runs.saved.find_checkpoint`.
        only: Name of the one policy to load; None loads all.
        networks: What the run was trained with in the place of Ludus's networks.

    Raises:
        CheckpointError: There is no such run or checkpoint, or it is corrupt.
        ConfigError: It has no policy called ``only``.
    """
    path, checkpoint = find_checkpoint(run, choice)
    if only is not None and only not in checkpoint.specs:
        hint = did_you_mean(only, sorted(checkpoint.specs), "its policies")
        raise ConfigError(f"{path} has no policy {only}", hint)
    names = list(checkpoint.specs) if only is None else [only]
    specs = {name: _spec(checkpoint, name, path) for name in names}
    policies = load_policies(path, specs, networks)
    return [
        TrainedPolicy(specs[name], policies[name], _recorded(checkpoint, policies[name]))
        for name in names
    ]


def spec_from_json(value: Mapping[str, Any]) -> PolicySpec:
    """Return the spec in a checkpoint, what ``PolicySpec.to_json`` made, with one agent.

    Unlike a spec from an engine it may have bounds that are infinite for some elements, as
    Gymnasium environments have them.

    Raises:
        KeyError, TypeError, ValueError: It is malformed.
    """
    return PolicySpec(
        name=str(value["name"]),
        observation=tuple(_entry(item) for item in value["observation"]),
        action=tuple(_component(item) for item in value["action"]),
        agents=(AgentSpec(0, None),),
        has_action_mask=bool(value["has_action_mask"]),
        episode=value["episode"],
        max_episode_steps=value["max_episode_steps"],
        settings=value["settings"],
    )


def _spec(checkpoint: Checkpoint, name: str, path: Path) -> PolicySpec:
    hint = "remove that checkpoint, or name another one by --checkpoint"
    try:
        spec = spec_from_json(checkpoint.specs[name])
    except (KeyError, TypeError, ValueError) as error:
        what = f"{type(error).__name__}: {error}"
        raise CheckpointError(f"{path}: the spec of policy {name}: {what}", hint) from None
    if spec.fingerprint() != checkpoint.fingerprints.get(name):
        raise CheckpointError(f"{path}: the spec of policy {name} is not what was saved", hint)
    return spec


def _recorded(checkpoint: Checkpoint, policy: Policy) -> dict[str, NDArray[Any]]:
    """Return recorded observations, if there are any and the policy takes such."""
    tensors = checkpoint.learners[policy.spec.name].tensors
    recorded: dict[str, NDArray[Any]] = {}
    for entry in policy.input_spec.observation:
        tensor = tensors.get(SAMPLES + entry.name)
        if tensor is None or tuple(tensor.shape[1:]) != entry.shape:
            return {}
        recorded[entry.name] = tensor.numpy().astype(entry.numpy_dtype)
    return recorded


def _entry(value: Mapping[str, Any]) -> ObservationEntry:
    return ObservationEntry(
        name=str(value["name"]),
        dtype=str(value["dtype"]),
        shape=tuple(int(size) for size in value["shape"]),
        low=_bound(value["low"], -math.inf),
        high=_bound(value["high"], math.inf),
    )


def _component(value: Mapping[str, Any]) -> ActionComponent:
    if value["kind"] == "discrete":
        return DiscreteAction(str(value["name"]), int(value["n"]))
    low, high = _bound(value["low"], -1.0), _bound(value["high"], 1.0)
    return ContinuousAction(str(value["name"]), int(value["size"]), low, high)


def _bound(value: Any, unbounded: float) -> Bound:
    if value is None:
        return unbounded
    # Not through float(), as 0 and 0.0 have different fingerprints.
    return tuple(cast(list[float], value)) if isinstance(value, list) else value
