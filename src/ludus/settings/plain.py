"""Settings as plain values: read from files, fitted to their types, written back."""

from __future__ import annotations

import dataclasses
import difflib
import json
import reprlib
import sys
import tomllib
import types
import typing
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import FunctionType
from typing import Any, Literal, TypeVar, cast

from ludus.disk import parse_json, read_plain_file
from ludus.errors import ConfigError, did_you_mean
from ludus.settings.checks import Settings
from ludus.settings.policy_config import ALGORITHM_CONFIGS, PolicyConfig, PPOConfig, SACConfig
from ludus.settings.train_config import TrainConfig
from ludus.settings.world_parameters import Parameter, check_parameters

__all__ = [
    "MARK",
    "ORIGINS",
    "as_mapping",
    "changed_settings",
    "fit_parameters",
    "flatten_settings",
    "foreign_error",
    "foreign_settings",
    "merge_settings",
    "plain_settings",
    "read_algorithm",
    "read_file",
    "saved_policy",
    "to_plain",
]

Struct = TypeVar("Struct", bound=Settings)

_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = 120
_short = _SHORT.repr

ORIGINS, MARK = "origins", "made_by"
"""Where ``config.json`` has the origins of its settings, and the mark of who made it
(:mod:`ludus.runs.trust`); older ones have none."""

_TOML_HINT = (
    "a settings file is TOML, with lines such as total_steps = 500000, texts in quotes, and a "
    "heading such as [ppo] above the settings of a group (docs/training.md)"
)


def merge_settings(config: Struct, values: Mapping[str, Any], where: str) -> Struct:
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
            inner = {
                field.name: f"{group}.{field.name}"
                for group in reversed(hints)
                if isinstance(of := getattr(config, group), Settings)
                for field in dataclasses.fields(of)
            }
            names = {**inner, **{own: own for own in hints}}
            close = difflib.get_close_matches(name, names, n=1, cutoff=0.8)
            known = [names[close[0]]] if close else sorted(hints)
            hint = did_you_mean(name, known, "known settings")
            raise ConfigError(f"{where}: unknown setting {name}", hint)
        current = getattr(config, name)
        if name == "policies":
            changes[name] = {
                policy: saved_policy(as_mapping(settings, policy, of), of)
                for policy, settings in as_mapping(value, name, where).items()
                for of in [f"{where}: policies.{policy}"]
            }
        elif isinstance(current, Settings):
            inner = as_mapping(value, name, where)
            changes[name] = merge_settings(current, inner, f"{where}: {name}")
        elif name == "bridge":  # which checks its settings itself
            changes[name] = {**current, **as_mapping(value, name, where)}
        else:
            changes[name] = _fit(value, hints[name], f"{where}: {name}")
    try:
        return dataclasses.replace(config, **changes)
    except ConfigError as error:
        raise ConfigError(f"{where}: {error.message}", error.hint) from None


def fit_parameters(values: Mapping[str, Any], where: str = "randomise") -> dict[str, Parameter]:
    """Return parameters of worlds from plain values.

    Raises:
        ConfigError: A value is none that a parameter can have, or no sampler.
    """
    fitted: dict[str, Parameter] = _fit(_plain(values), dict[str, Parameter], where)
    check_parameters(where, fitted)
    return fitted


def saved_policy(values: Mapping[str, Any], where: str) -> PolicyConfig:
    """Return the settings of one policy from those that a run saved.

    Raises:
        ConfigError: A name is unknown, or a value has the wrong type or is out of range.
    """
    algorithm = read_algorithm(values, where)
    if foreign := foreign_settings(values, algorithm):
        raise foreign_error(foreign[0], algorithm, where)
    return merge_settings(ALGORITHM_CONFIGS[algorithm](), values, where)


def read_algorithm(values: Mapping[str, Any], where: str) -> str:
    """Return the algorithm that the settings of a policy name, PPO if they name none."""
    return _fit(values.get("algorithm", "ppo"), Literal["ppo", "sac"], f"{where}: algorithm")


def foreign_settings(values: Mapping[str, Any], algorithm: str) -> list[str]:
    """Return the names of settings that only algorithms other than this one have."""
    names = {
        known: {part.name for part in dataclasses.fields(config)}
        for known, config in ALGORITHM_CONFIGS.items()
    }
    others = set[str]().union(*names.values()) - names[algorithm]
    return [name for name in values if name in others]


def foreign_error(name: str, algorithm: str, where: str) -> ConfigError:
    """Return the error about a setting that only another algorithm has."""
    return ConfigError(
        f"{where}: {algorithm}, which this policy uses, has no setting {name}",
        "set algorithm as well, or leave that setting out",
    )


def read_file(path: Path) -> dict[str, Any]:
    """Return the settings in a TOML file, or in a JSON file as runs save them, without origins.

    Raises:
        ConfigError: The file cannot be read or is malformed.
    """
    kind, hint = ("JSON", "") if path.suffix == ".json" else ("TOML", _TOML_HINT)
    try:
        data = read_plain_file(path)
    except OSError as error:
        reason = error.strerror or str(error)
        raise ConfigError(f"cannot read the settings in {path}: {reason}", hint) from None
    values = cast(Any, None)
    try:
        values = parse_json(data) if kind == "JSON" else tomllib.loads(data.decode())
    except RecursionError:
        raise ConfigError(f"{path} is not valid {kind}: nested too deeply") from None
    except ValueError as error:
        raise ConfigError(f"{path} is not valid {kind}: {error}", hint) from None
    settings = dict(as_mapping(values, "the file", str(path)))
    for name in (ORIGINS, MARK):
        settings.pop(name, None)
    return settings


def to_plain(config: PolicyConfig | TrainConfig) -> dict[str, Any]:
    """Return ``config`` as JSON values; :func:`merge_settings` takes them back."""
    plain = json.dumps(dataclasses.asdict(config), default=_as_text)
    return cast(dict[str, Any], json.loads(plain))


def _as_text(value: Any) -> str:
    """Return a setting that JSON does not know as a command line writes it."""
    if isinstance(value, FunctionType):
        return f"{value.__module__}:{value.__qualname__}"
    return str(value)


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
        value = changed_settings(value)
    if isinstance(value, Mapping):
        return {name: _plain(each) for name, each in cast(Mapping[str, Any], value).items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in cast(Sequence[Any], value)]
    return str(value) if isinstance(value, Path) else value


def flatten_settings(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested settings by dotted name: ``ppo.epochs``; an empty mapping is a value.

    Args:
        values: Plain values by setting name; mappings for nested settings.
        prefix: Put before every name.
    """
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping) and value:
            flat |= flatten_settings(cast(Mapping[str, Any], value), f"{prefix}{name}.")
        else:
            flat[f"{prefix}{name}"] = value
    return flat


def changed_settings(config: Any) -> dict[str, Any]:
    """Return the fields of a struct that differ from the defaults."""
    default = type(config)()
    named = {part.name: getattr(config, part.name) for part in dataclasses.fields(config)}
    return {name: value for name, value in named.items() if value != getattr(default, name)}


def as_mapping(value: Any, name: str, where: str) -> Mapping[str, Any]:
    """Return ``value``, which must be a mapping; ``name`` and ``where`` are for the message.

    Raises:
        ConfigError: It is something else.
    """
    if not isinstance(value, Mapping):
        raise ConfigError(f"{where}: {name} must hold settings by name, not {_short(value)}")
    return cast(Mapping[str, Any], value)


_MISMATCH = object()


def _fit(value: Any, hint: Any, where: str) -> Any:
    """Return ``value`` as the type ``hint``.

    Raises:
        ConfigError: It does not fit.
    """
    is_union = typing.get_origin(hint) in {types.UnionType, typing.Union}
    for option in typing.get_args(hint) if is_union else (hint,):
        fitted = _fit_one(value, option, where)
        if fitted is not _MISMATCH:
            return fitted
    raise ConfigError(f"{where} must be {_describe(hint)}, not {_short(value)}")


def _fit_one(value: Any, hint: Any, where: str) -> Any:  # noqa: PLR0911 - a table of types
    origin = typing.get_origin(hint)
    if hint is types.NoneType:
        return None if value is None or value == "none" else _MISMATCH
    if origin is Literal:
        return value if value in typing.get_args(hint) else _MISMATCH
    if origin is tuple:
        if not isinstance(value, list | tuple):
            return _MISMATCH
        part = typing.get_args(hint)[0]
        return tuple(_fit(item, part, where) for item in cast(list[Any], value))
    if origin is dict:
        part = typing.get_args(hint)[1]
        entries = as_mapping(value, where.rpartition(" ")[2], where)
        return {name: _fit(item, part, f"{where}.{name}") for name, item in entries.items()}
    if dataclasses.is_dataclass(hint):
        if not isinstance(value, Mapping):
            return _MISMATCH
        return merge_settings(cast(Any, hint)(), cast(Mapping[str, Any], value), where)
    if hint is Path:
        return Path(value) if isinstance(value, str | Path) and str(value) else _MISMATCH
    if hint in {bool, str}:
        return value if isinstance(value, hint) else _MISMATCH
    if isinstance(value, bool) or not isinstance(value, int | float):
        return _MISMATCH
    if not -sys.float_info.max <= value <= sys.float_info.max:  # too many digits, or none
        return float(value) if hint is float and isinstance(value, float) else _MISMATCH
    if hint is float:
        return float(value)
    # Godot writes every number as 20.0. (msgspec 0.22 refuses that where an integer belongs.)
    return int(value) if float(value).is_integer() else _MISMATCH


def _describe(hint: Any) -> str:
    if typing.get_origin(hint) is Literal:
        return " or ".join(repr(option) for option in typing.get_args(hint))
    names = {"int": "a whole number", "float": "a number", "bool": "true or false",
             "str": "a text", "Path": "a path", "NoneType": "none",
             "Phase": "a table with updates and modes", "Lesson": "a table with parameters",
             "Sampler": "a table with uniform, normal or choice"}  # fmt: skip
    if typing.get_origin(hint) in {types.UnionType, typing.Union}:
        return " or ".join(_describe(option) for option in typing.get_args(hint))
    if typing.get_origin(hint) is tuple:
        part = _describe(typing.get_args(hint)[0])
        return f"a list of {part.removeprefix('a ')}s"
    return names.get(getattr(hint, "__name__", ""), str(hint))
