"""Settings in layers, later ones win: defaults, scene, file, command line.

Scenes, files and saved runs hold plain mappings; this module lays them over a config struct and
refuses names and values that do not fit.
"""

from __future__ import annotations

import dataclasses
import difflib
import json
import tomllib
import types
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, TypeVar, cast

from ludus.errors import ConfigError
from ludus.spec import PolicySpec
from ludus.train.config import PPOConfig, TrainConfig

__all__ = ["changed_settings", "lay_over", "policy_settings", "read_file", "to_plain"]

Struct = TypeVar("Struct", PPOConfig, TrainConfig)


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
            changes[name] = _lay_over_policies(cast(TrainConfig, config), value, where)
        elif dataclasses.is_dataclass(current):
            changes[name] = lay_over(cast(PPOConfig, current), _mapping(value, name, where), where)
        else:
            changes[name] = _fit(value, hints[name], f"{where}: {name}")
    try:
        return dataclasses.replace(config, **changes)
    except ConfigError as error:
        raise ConfigError(f"{where}: {error.message}", error.hint) from None


def policy_settings(
    config: TrainConfig, policy: PolicySpec, file: Mapping[str, Any] | None = None
) -> PPOConfig:
    """Return one policy's settings: defaults, then its scene, then ``config`` or ``file``.

    Args:
        config: Read only without ``file``: what differs from the defaults in ``config.ppo``
            counts as set; ``config.policies`` wins over all.
        policy: Whose settings; its scene's are in ``policy.settings``.
        file: Plain settings to lay over the scene's instead of ``config``.

    Raises:
        ConfigError: A setting does not fit; the text names policy and setting.
    """
    if file is None and policy.name in config.policies:
        return config.policies[policy.name]
    settings = lay_over(PPOConfig(), policy.settings, f"policy {policy.name} (scene)")
    if file is None:
        return lay_over(settings, changed_settings(config.ppo), f"policy {policy.name}")
    settings = lay_over(settings, _mapping(file.get("ppo", {}), "ppo", "file"), "file, ppo")
    own = _mapping(file.get("policies", {}), "policies", "file").get(policy.name, {})
    where = f"file, policies.{policy.name}"
    return lay_over(settings, _mapping(own, policy.name, where), where)


def read_file(path: Path) -> dict[str, Any]:
    """Return the settings in a TOML file, or in a JSON file as runs save them.

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
    return dict(_mapping(values, "the file", str(path)))


def to_plain(config: PPOConfig | TrainConfig) -> dict[str, Any]:
    """Return ``config`` as JSON values; :func:`lay_over` takes them back."""
    plain = json.dumps(dataclasses.asdict(config), default=str)
    return cast(dict[str, Any], json.loads(plain))


def changed_settings(config: PPOConfig) -> dict[str, Any]:
    """Return the settings that differ from the defaults."""
    defaults = to_plain(PPOConfig())
    return {name: value for name, value in to_plain(config).items() if value != defaults[name]}


def _lay_over_policies(config: TrainConfig, value: Any, where: str) -> dict[str, PPOConfig]:
    policies = dict(config.policies)
    for name, settings in _mapping(value, "policies", where).items():
        base = policies.get(name, config.ppo)
        place = f"{where}: policies.{name}"
        policies[name] = lay_over(base, _mapping(settings, name, place), place)
    return policies


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
    options = typing.get_args(hint) if typing.get_origin(hint) is types.UnionType else (hint,)
    for option in options:
        fitted = _fit_one(value, option, where)
        if fitted is not _MISFIT:
            return fitted
    raise ConfigError(f"{where} must be {_describe(hint)}, not {value!r}")


_MISFIT = object()


def _fit_one(value: Any, hint: Any, where: str) -> Any:
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
             "str": "a text", "Path": "a path", "NoneType": "none"}  # fmt: skip
    if typing.get_origin(hint) is types.UnionType:
        return " or ".join(_describe(option) for option in typing.get_args(hint))
    if typing.get_origin(hint) is tuple:
        return "a list of whole numbers"
    return names.get(getattr(hint, "__name__", ""), str(hint))
