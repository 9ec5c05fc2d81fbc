"""Settings in layers, later ones win: defaults, scene, resumed run, file, command line.

A layer holds plain values by setting name, and where they come from. :func:`resolve` merges all
layers over the defaults once the game has told its policies, and notes the origin of each setting.
"""

from __future__ import annotations

import dataclasses
import json
import logging
import secrets
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ludus.errors import ConfigError
from ludus.settings.plain import (
    as_mapping,
    changed_settings,
    flatten_settings,
    foreign_error,
    foreign_settings,
    merge_settings,
    plain_settings,
    read_algorithm,
    to_plain,
)
from ludus.settings.policy_config import ALGORITHM_CONFIGS, PolicyConfig
from ludus.settings.train_config import TrainConfig
from ludus.spec import PolicySpec

__all__ = [
    "PYTHON",
    "Layer",
    "Resolved",
    "changes_since",
    "merge",
    "python_layer",
    "resolve",
    "resolve_policy",
]

DEFAULT, PYTHON = "default", "Python"

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Layer:
    """Some settings of a run.

    Attributes:
        origin: Where they come from: ``scene``, ``file a.toml``, ``command line``.
        values: Plain values by setting name; mappings for nested settings.
        is_saved: Whether they are all the settings of a run, most of which nobody chose.
    """

    origin: str
    values: Mapping[str, Any]
    is_saved: bool = False


@dataclass(frozen=True)
class Resolved:
    """The settings that a run is trained with.

    Attributes:
        config: All settings, with those of each policy of the game, and a seed.
        origins: Where each setting that is not a default comes from, by dotted name:
            ``policies.hero.learning_rate``.
    """

    config: TrainConfig
    origins: Mapping[str, str] = field(default_factory=dict[str, str])

    def rows(self) -> list[tuple[str, Any, str]]:
        """Return name, plain value and origin of every setting."""
        return [
            (name, value, self.origins.get(name, DEFAULT))
            for name, value in flatten_settings(to_plain(self.config)).items()
        ]


def python_layer(config: TrainConfig) -> Layer:
    """Return what a script has set, which is what differs from the defaults.

    Settings of single policies count as a whole: a script that gives them has chosen them all.
    """
    return Layer(PYTHON, plain_settings(changed_settings(config)))


def changes_since(before: Mapping[str, Any], config: TrainConfig) -> dict[str, str]:
    """Return what differs between saved settings and ``config``: ``"1 instead of 2"`` by name."""
    saved, now = flatten_settings(before), flatten_settings(to_plain(config))
    return {
        name: f"{json.dumps(value)} instead of {json.dumps(saved[name])}"
        for name, value in now.items()
        if name.partition(".")[0] not in ALGORITHM_CONFIGS  # what a policy has of it is named
        and name in saved
        and saved[name] != value
    }


def merge(layers: Sequence[Layer]) -> TrainConfig:
    """Return what can be told before the game is open: all but the settings of single policies.

    Raises:
        ConfigError: A name is unknown, or a value has the wrong type or is out of range.
    """
    config = TrainConfig()
    for layer in layers:
        values = {name: value for name, value in layer.values.items() if name != "policies"}
        config = merge_settings(config, values, layer.origin)
    return config


def resolve(layers: Sequence[Layer], policies: Mapping[str, PolicySpec]) -> Resolved:
    """Return the settings of a run in a game.

    Args:
        layers: Earlier ones first.
        policies: What the game declares; ``pool.policies``.

    Raises:
        ConfigError: A setting does not fit, or is one of a policy that the game does not have.
    """
    config = merge(layers)
    origins = _origins(layers)
    settings: dict[str, PolicyConfig] = {}
    for name, policy in policies.items():
        settings[name], chosen = resolve_policy(layers, policy)
        origins |= {f"policies.{name}.{setting}": origin for setting, origin in chosen.items()}
    for layer in layers:
        named = layer.values.get("policies", {})
        unknown = [] if layer.is_saved else [n for n in named if not _named(n, policies)]
        if unknown:
            raise ConfigError(
                f"{layer.origin}: there is no policy {unknown[0]}",
                f"policies of the game: {', '.join(policies)}",
            )
    if config.seed is None:
        config = dataclasses.replace(config, seed=secrets.randbits(31))
        origins["seed"] = "random"
    return Resolved(dataclasses.replace(config, policies=settings), origins)


def resolve_policy(
    layers: Sequence[Layer], policy: PolicySpec
) -> tuple[PolicyConfig, dict[str, str]]:
    """Return one policy's settings, and the origin of each that is not a default.

    In each layer, ``policies.NAME`` wins over the section of its algorithm. The last layer to name
    an algorithm decides; what only another algorithm knows is left out of the layers before.

    Raises:
        ConfigError: A setting does not fit; the text names policy and setting.
    """
    parts = [_Part(policy.settings, "scene", f"policy {policy.name} (scene)")]
    for layer in layers:
        parts += _parts_of(layer, policy.name)
    algorithm, algorithm_part = "ppo", 0
    for index, part in enumerate(parts):
        if "algorithm" in part.values:
            algorithm, algorithm_part = read_algorithm(part.values, part.where), index
    settings: PolicyConfig = ALGORITHM_CONFIGS[algorithm]()
    origins: dict[str, str] = {}
    for index, part in enumerate(parts):
        if part.algorithm not in {None, algorithm}:
            continue
        values = _own_values(part, algorithm, is_before=index < algorithm_part)
        before = settings
        settings = merge_settings(settings, values, part.where)
        for name in values:
            if not part.is_saved or getattr(before, name) != getattr(settings, name):
                origins[name] = part.origin
    return settings, origins


@dataclass(frozen=True)
class _Part:
    """What one layer says of one policy in one place; of an algorithm's section, which one."""

    values: Mapping[str, Any]
    origin: str
    where: str
    algorithm: str | None = None
    is_saved: bool = False


def _parts_of(layer: Layer, policy: str) -> Iterable[_Part]:
    for algorithm in ALGORITHM_CONFIGS:
        where = f"{layer.origin}: {algorithm}"
        section = as_mapping(layer.values.get(algorithm, {}), algorithm, layer.origin)
        values = {name: value for name, value in section.items() if name != "algorithm"}
        yield _Part(values, layer.origin, where, algorithm, layer.is_saved)
    algorithm = layer.values.get("algorithm")
    if algorithm is not None:
        yield _Part({"algorithm": algorithm}, layer.origin, layer.origin)
    policies = as_mapping(layer.values.get("policies", {}), "policies", layer.origin)
    for name, values in policies.items():
        if _named(name, (policy,)):
            where = f"{layer.origin}: policies.{name}"
            own = as_mapping(values, name, where)
            yield _Part(own, layer.origin, where, is_saved=layer.is_saved)


def _named(name: str, policies: Iterable[str]) -> bool:
    """Tell whether a policy has this name; flags are written with ``-`` for ``_``."""
    return name.replace("_", "-") in {policy.replace("_", "-") for policy in policies}


def _own_values(part: _Part, algorithm: str, *, is_before: bool) -> dict[str, Any]:
    """Return what of a part the algorithm knows; only parts before its choice may hold more."""
    foreign = foreign_settings(part.values, algorithm)
    if foreign and not is_before:
        raise foreign_error(foreign[0], algorithm, part.where)
    if foreign:
        log.info("%s: %s left out, %s has no such setting", part.where, foreign, algorithm)
    values = {name: value for name, value in part.values.items() if name not in foreign}
    return values | {"algorithm": algorithm} if "algorithm" in values else values


def _origins(layers: Sequence[Layer]) -> dict[str, str]:
    """Return the origin of every setting of the run itself."""
    current = flatten_settings(to_plain(TrainConfig()))
    origins: dict[str, str] = {}
    for layer in layers:
        for name, value in flatten_settings(layer.values).items():
            if name.partition(".")[0] == "policies":
                continue
            if not layer.is_saved or current.get(name) != value:
                origins[name] = layer.origin
            current[name] = value
    return origins
