"""Settings in layers, later ones win: defaults, scene, resumed run, file, command line.

A layer holds plain values by setting name, and where they come from. :func:`resolve` lays all
layers over the defaults once the game has told its policies, and notes the origin of each setting.
"""

from __future__ import annotations

import dataclasses
import difflib
import json
import logging
import secrets
import tomllib
import types
import typing
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeVar, cast

from ludus.errors import ConfigError
from ludus.settings.policy_config import ALGORITHM_CONFIGS, PolicyConfig, PPOConfig, SACConfig
from ludus.settings.train_config import LeagueConfig, Phase, TrainConfig
from ludus.spec import PolicySpec

__all__ = [
    "ORIGINS",
    "Layer",
    "Resolved",
    "lay_over",
    "merge",
    "plain_settings",
    "python_layer",
    "read_file",
    "resolve",
    "resolve_policy",
    "saved_policy",
    "to_plain",
]

Struct = TypeVar("Struct", PPOConfig, SACConfig, TrainConfig, LeagueConfig, Phase)

DEFAULT, PYTHON = "default", "Python"
ORIGINS = "origins"
"""Where ``config.json`` has the origins of its settings; older ones have none."""

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
            for name, value in _leaves(to_plain(self.config))
        ]


def python_layer(config: TrainConfig) -> Layer:
    """Return what a script has set, which is what differs from the defaults.

    Settings of single policies count as a whole: a script that gives them has chosen them all.
    """
    return Layer(PYTHON, plain_settings(_changed(config)))


def plain_settings(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings as a script writes them as the values of a :class:`Layer`.

    Args:
        values: By name; plain, or structs such as ``PPOConfig``, of which counts what differs
            from the defaults, below ``policies`` everything.
    """
    plain = {name: _plain(value) for name, value in values.items() if name != "policies"}
    if isinstance(policies := values.get("policies"), Mapping):
        named = cast(Mapping[str, Any], policies)
        plain["policies"] = {
            name: to_plain(own) if isinstance(own, PPOConfig | SACConfig) else _plain(own)
            for name, own in named.items()
        }
    elif "policies" in values:
        plain["policies"] = policies
    return plain


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = _changed(value)
    if isinstance(value, Mapping):
        return {name: _plain(each) for name, each in cast(Mapping[str, Any], value).items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in cast(Sequence[Any], value)]
    return str(value) if isinstance(value, Path) else value


def _changed(config: Any) -> dict[str, Any]:
    """Return the fields of a struct that differ from the defaults."""
    default = type(config)()
    named = {part.name: getattr(config, part.name) for part in dataclasses.fields(config)}
    return {name: value for name, value in named.items() if value != getattr(default, name)}


def merge(layers: Sequence[Layer]) -> TrainConfig:
    """Return what can be told before the game is open: all but the settings of single policies.

    Raises:
        ConfigError: A name is unknown, or a value has the wrong type or is out of range.
    """
    config = TrainConfig()
    for layer in layers:
        values = {name: value for name, value in layer.values.items() if name != "policies"}
        config = lay_over(config, values, layer.origin)
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
    chosen, since = _choose_algorithm(parts)
    settings: PolicyConfig = ALGORITHM_CONFIGS[chosen]()
    origins: dict[str, str] = {}
    for index, part in enumerate(parts):
        if part.algorithm not in {None, chosen}:
            continue
        values = _own_values(part, chosen, is_before=index < since)
        before = settings
        settings = lay_over(cast(PPOConfig, settings), values, part.where)
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
        section = _mapping(layer.values.get(algorithm, {}), algorithm, layer.origin)
        values = {name: value for name, value in section.items() if name != "algorithm"}
        yield _Part(values, layer.origin, where, algorithm, layer.is_saved)
    algorithm = layer.values.get("algorithm")
    if algorithm is not None:
        yield _Part({"algorithm": algorithm}, layer.origin, layer.origin)
    for name, values in _mapping(
        layer.values.get("policies", {}), "policies", layer.origin
    ).items():
        if _named(name, (policy,)):
            where = f"{layer.origin}: policies.{name}"
            own = _mapping(values, name, where)
            yield _Part(own, layer.origin, where, is_saved=layer.is_saved)


def _named(name: str, policies: Iterable[str]) -> bool:
    """Tell whether a policy has this name; flags are written with ``-`` for ``_``."""
    return name.replace("_", "-") in {policy.replace("_", "-") for policy in policies}


def _choose_algorithm(parts: Sequence[_Part]) -> tuple[str, int]:
    """Return the algorithm that the last part to name one names, and that part's index."""
    chosen, since = "ppo", 0
    for index, part in enumerate(parts):
        if "algorithm" in part.values:
            options = Literal["ppo", "sac"]
            chosen = _fit(part.values["algorithm"], options, f"{part.where}: algorithm")
            since = index
    return chosen, since


def _own_values(part: _Part, algorithm: str, *, is_before: bool) -> dict[str, Any]:
    """Return what of a part the algorithm knows."""
    foreign = [name for name in part.values if _is_of_another(name, algorithm)]
    if foreign and not is_before:
        raise ConfigError(
            f"{part.where}: {foreign[0]} is no setting of {algorithm}, which this policy uses",
            "set algorithm as well, or leave that setting out",
        )
    if foreign:
        log.info("%s: %s left out, %s has no such setting", part.where, foreign, algorithm)
    values = {name: value for name, value in part.values.items() if name not in foreign}
    return values | {"algorithm": algorithm} if "algorithm" in values else values


def _is_of_another(name: str, algorithm: str) -> bool:
    known = {kind: {part.name for part in dataclasses.fields(of)}
             for kind, of in ALGORITHM_CONFIGS.items()}  # fmt: skip
    return name not in known[algorithm] and any(name in names for names in known.values())


def _origins(layers: Sequence[Layer]) -> dict[str, str]:
    """Return the origin of every setting of the run itself."""
    current = dict(_leaves(to_plain(TrainConfig())))
    origins: dict[str, str] = {}
    for layer in layers:
        for name, value in _leaves(layer.values):
            if name.partition(".")[0] == "policies":
                continue
            if not layer.is_saved or current.get(name) != value:
                origins[name] = layer.origin
            current[name] = value
    return origins


def _leaves(values: Mapping[str, Any], prefix: str = "") -> Iterable[tuple[str, Any]]:
    for name, value in values.items():
        if isinstance(value, Mapping) and value:
            yield from _leaves(cast(Mapping[str, Any], value), f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def saved_policy(values: Mapping[str, Any], where: str) -> PolicyConfig:
    """Return the settings of one policy from those a run saved."""
    part = _Part(values, where, where)
    algorithm, _ = _choose_algorithm([part])
    settings = cast(PPOConfig, ALGORITHM_CONFIGS[algorithm]())
    return lay_over(settings, _own_values(part, algorithm, is_before=False), where)


def lay_over(config: Struct, values: Mapping[str, Any], where: str) -> Struct:
    """Return ``config`` with ``values`` in place of its own.

    Args:
        config: What stays where ``values`` says nothing.
        values: Plain values by setting name; mappings for nested settings.
        where: Where ``values`` come from, for messages: ``"policy hero (scene)"``.

    Raises:
        ConfigError: A name is unknown, or a value has the wrong type or is out of range.
    """
    hints = typing.get_type_hints(type(config))
    changes: dict[str, Any] = {}
    for name, value in values.items():
        if name not in hints:
            raise _unknown(name, list(hints), where)
        current = getattr(config, name)
        if name == "policies":
            changes[name] = _lay_over_policies(value, where)
        elif dataclasses.is_dataclass(current):
            inner = cast(PPOConfig, current)
            changes[name] = lay_over(inner, _mapping(value, name, where), f"{where}: {name}")
        else:
            changes[name] = _fit(value, hints[name], f"{where}: {name}")
    try:
        return dataclasses.replace(config, **changes)
    except ConfigError as error:
        raise ConfigError(f"{where}: {error.message}", error.hint) from None


def read_file(path: Path) -> dict[str, Any]:
    """Return the settings in a TOML file, or in a JSON file as runs save them, without origins.

    Raises:
        ConfigError: The file cannot be read or is malformed.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"cannot read the settings in {path}: {error}") from None
    try:
        values: Any = json.loads(text) if path.suffix == ".json" else tomllib.loads(text)
    except (json.JSONDecodeError, tomllib.TOMLDecodeError) as error:
        kind = "JSON" if path.suffix == ".json" else "TOML"
        raise ConfigError(f"{path} is not valid {kind}: {error}") from None
    settings = dict(_mapping(values, "the file", str(path)))
    settings.pop(ORIGINS, None)
    return settings


def to_plain(config: PolicyConfig | TrainConfig) -> dict[str, Any]:
    """Return ``config`` as JSON values; :func:`lay_over` takes them back."""
    plain = json.dumps(dataclasses.asdict(config), default=str)
    return cast(dict[str, Any], json.loads(plain))


def _lay_over_policies(value: Any, where: str) -> dict[str, PolicyConfig]:
    """Return the settings of single policies as a run saved them."""
    return {
        name: saved_policy(_mapping(settings, name, f"{where}: policies.{name}"),
                           f"{where}: policies.{name}")
        for name, settings in _mapping(value, "policies", where).items()
    }  # fmt: skip


def _mapping(value: Any, name: str, where: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise ConfigError(f"{where}: {name} must hold settings by name, not {value!r}")
    return cast(Mapping[str, Any], value)


def _unknown(name: str, known: list[str], where: str) -> ConfigError:
    close = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    hint = f"did you mean {close[0]}?" if close else f"known settings: {', '.join(sorted(known))}"
    return ConfigError(f"{where}: unknown setting {name}", hint)


def _fit(value: Any, hint: Any, where: str) -> Any:
    """Return ``value`` as the type ``hint``; whole floats pass as integers, as JSON has no others.

    Raises:
        ConfigError: It does not fit.
    """
    is_union = typing.get_origin(hint) in {types.UnionType, typing.Union}
    for option in typing.get_args(hint) if is_union else (hint,):
        fitted = _fit_one(value, option, where)
        if fitted is not _MISFIT:
            return fitted
    raise ConfigError(f"{where} must be {_describe(hint)}, not {value!r}")


_MISFIT = object()


def _fit_one(value: Any, hint: Any, where: str) -> Any:  # noqa: PLR0911 - a table of types
    origin = typing.get_origin(hint)
    if hint is types.NoneType:
        return None if value is None or value == "none" else _MISFIT
    if origin is Literal:
        return value if value in typing.get_args(hint) else _MISFIT
    if origin is tuple:
        if not isinstance(value, list | tuple):
            return _MISFIT
        part = typing.get_args(hint)[0]
        return tuple(_fit(item, part, where) for item in cast(list[Any], value))
    if origin is dict:
        part = typing.get_args(hint)[1]
        entries = _mapping(value, where.rpartition(" ")[2], where)
        return {name: _fit(item, part, f"{where}.{name}") for name, item in entries.items()}
    if dataclasses.is_dataclass(hint):
        return lay_over(cast(Any, hint)(), _mapping(value, "it", where), where)
    return _fit_scalar(value, hint)


def _fit_scalar(value: Any, hint: Any) -> Any:
    if hint is Path:
        return Path(value) if isinstance(value, str | Path) and str(value) else _MISFIT
    if hint in {bool, str}:
        return value if isinstance(value, hint) else _MISFIT
    if isinstance(value, bool) or not isinstance(value, int | float):
        return _MISFIT
    if hint is float:
        return float(value)
    return int(value) if float(value).is_integer() else _MISFIT


def _describe(hint: Any) -> str:
    if typing.get_origin(hint) is Literal:
        return " or ".join(repr(option) for option in typing.get_args(hint))
    names = {"int": "a whole number", "float": "a number", "bool": "true or false",
             "str": "a text", "Path": "a path", "NoneType": "none",
             "Phase": "a table with updates and modes"}  # fmt: skip
    if typing.get_origin(hint) in {types.UnionType, typing.Union}:
        return " or ".join(_describe(option) for option in typing.get_args(hint))
    if typing.get_origin(hint) is tuple:
        part = _describe(typing.get_args(hint)[0])
        return f"a list of {part.removeprefix('a ')}s"
    return names.get(getattr(hint, "__name__", ""), str(hint))
