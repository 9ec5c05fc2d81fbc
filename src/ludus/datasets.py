"""Minari datasets: what those of a game are called, and demonstrations read from them."""

from __future__ import annotations

import importlib
import importlib.util
import logging
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ludus.errors import ActionError, ConfigError, RunError, SetupError
from ludus.spec import PolicySpec
from ludus.spec.batch import ActionBatch
from ludus.spec.spaces import FLAT_ENTRY, action_space, observation_space, to_action_batch

__all__ = ["Demonstrations", "dataset_names", "read_demonstrations", "require_minari"]

NAME = re.compile(r"(?:[\w.-]+/)*[\w.-]+?-v\d+")

log = logging.getLogger(__name__)

Space = spaces.Space[Any]


@dataclass(frozen=True)
class Demonstrations:
    """Steps of complete episodes of one policy, episode by episode; ``n`` in sum.

    Attributes:
        name: Of the dataset.
        observation: Per entry ``dtype[n, *shape]``, what was acted on.
        actions: Of ``n`` slots, in units of the game.
        mask: ``bool[n, mask_size]``, True = allowed; None without masks.
        lengths: Steps of each episode.
    """

    name: str
    observation: dict[str, NDArray[Any]]
    actions: ActionBatch
    mask: NDArray[np.bool_] | None
    lengths: list[int]

    @property
    def num_steps(self) -> int:
        """Steps in sum."""
        return sum(self.lengths)


def require_minari() -> Any:
    """Return the module ``minari``.

    Raises:
        SetupError: It or h5py is missing.
    """
    for package in ("minari", "h5py"):
        if importlib.util.find_spec(package) is None:
            raise SetupError(f"{package} is not installed", "pip install 'minari[hdf5]'")
    return importlib.import_module("minari")


def dataset_names(dataset: str, policies: Iterable[str]) -> dict[str, str]:
    """Return the name of each policy's dataset.

    Of several, ``tag/play-v0`` becomes ``tag/play-chaser-v0``.

    Raises:
        ConfigError: ``dataset`` is not a name that Minari takes.
    """
    if not NAME.fullmatch(dataset):
        raise ConfigError(
            f"{dataset!r} is not a valid dataset name", "name it such as cartpole/expert-v0"
        )
    policies = list(policies)
    if len(policies) == 1:
        return dict.fromkeys(policies, dataset)
    stem, _, version = dataset.rpartition("-v")
    words = {name: re.sub(r"[^\w.]+", "_", name) for name in policies}
    return {name: f"{stem}-{word}-v{version}" for name, word in words.items()}


def read_demonstrations(
    dataset: str, policies: Mapping[str, PolicySpec]
) -> dict[str, Demonstrations]:
    """Return the demonstrations for each policy that has a dataset.

    Args:
        dataset: What ``ludus record --dataset`` was given.
        policies: What the game declares.

    Raises:
        SetupError: Minari or h5py is missing.
        ConfigError: There is no such dataset, or it does not fit the game.
        RunError: A dataset cannot be read.
    """
    minari = require_minari()
    names = dataset_names(dataset, policies)
    found = {policy: name for policy, name in names.items() if name in minari.list_local_datasets()}
    if not found:
        raise ConfigError(
            f"there is no dataset {' or '.join(names.values())}",
            "minari list local shows those that are, ludus record --dataset writes one; "
            "without one: --imitate none",
        )
    for policy in names.keys() - found.keys():
        log.warning("policy %s learns without demonstrations: there is no dataset %s", policy,
                    names[policy])  # fmt: skip
    return {policy: _read(minari, name, policies[policy]) for policy, name in found.items()}


def _read(minari: Any, name: str, spec: PolicySpec) -> Demonstrations:
    try:
        dataset = minari.load_dataset(name)
        misfit = _misfit(spec, dataset.observation_space, dataset.action_space)
        episodes = [] if misfit else list(dataset.iterate_episodes())
    except (OSError, ValueError, KeyError) as error:
        raise RunError(f"cannot read the dataset {name}: {error}") from error
    where = f"dataset {name} does not fit policy {spec.name}"
    if misfit:
        raise ConfigError(f"{where}: {misfit}", "imitate takes a dataset of the same game")
    lengths = [len(episode.rewards) for episode in episodes]
    observed = [_entries(episode.observations, FLAT_ENTRY) for episode in episodes]
    observation = {
        entry.name: np.concatenate([one[entry.name][:-1] for one in observed]).astype(
            entry.numpy_dtype, copy=False
        )
        for entry in spec.observation
    }
    try:
        actions = to_action_batch(
            spec, _joined([episode.actions for episode in episodes]), sum(lengths)
        )
    except ActionError as error:
        raise ConfigError(f"{where}: {error.message}") from error
    mask = None
    if spec.mask_size and all("action_mask" in (one.infos or {}) for one in episodes):
        masks = [one.infos["action_mask"][:-1] for one in episodes]
        mask = np.concatenate(masks).astype(np.bool_)
        _check_allowed(where, spec, actions, mask)
    return Demonstrations(name, observation, actions, mask, lengths)


def _misfit(spec: PolicySpec, observation: Space, action: Space) -> str | None:
    """Return what of a dataset's spaces the game's differ from, or None."""
    found, expected = (
        _entries(getattr(space, "spaces", space), FLAT_ENTRY)
        for space in (observation, observation_space(spec))
    )
    for name in {**expected, **found}:
        if name not in found or name not in expected:
            which = "the dataset" if name in expected else "the game"
            return f"{which} has no observation {name!r}"
        one, other = found[name], expected[name]
        if one.shape != other.shape or not np.can_cast(one.dtype, other.dtype, "same_kind"):
            return f"observation {name!r} is {one}, that of the game {other}"
    if action != action_space(spec):
        return f"actions are {action}, those of the game {action_space(spec)}"
    return None


def _entries(value: Any, name: str) -> dict[str, Any]:
    if isinstance(value, Mapping):
        return dict(cast(Mapping[str, Any], value))
    return {name: value}


def _joined(parts: list[Any]) -> Any:
    """Return batched values of all episodes as one batch; dictionaries by entry."""
    if isinstance(parts[0], Mapping):
        values = [cast(Mapping[str, NDArray[Any]], part) for part in parts]
        return {name: np.concatenate([part[name] for part in values]) for name in values[0]}
    return np.concatenate(parts)


def _check_allowed(
    where: str, spec: PolicySpec, actions: ActionBatch, mask: NDArray[np.bool_]
) -> None:
    starts = np.cumsum([0, *spec.nvec[:-1]])
    is_allowed = np.take_along_axis(mask, actions.discrete + starts, 1).all(1)
    if not is_allowed.all():
        raise ConfigError(f"{where}: step {int(is_allowed.argmin())} takes an action that its "
                          "mask forbids")  # fmt: skip
