"""Settings in layers, later ones win: defaults, scene, file, command line.

Scenes, files and saved runs hold plain mappings; this module lays them over a config struct and
refuses names and values that do not fit.
"""

from __future__ import annotations

import dataclasses
import difflib
import json
import logging
import tomllib
import types
import typing
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar, cast

from ludus.errors import ConfigError
from ludus.settings.policy_config import ALGORITHM_CONFIGS, PolicyConfig, PPOConfig, SACConfig
from ludus.settings.train_config import LeagueConfig, Phase, TrainConfig
from ludus.spec import PolicySpec

__all__ = ["changed_settings", "lay_over", "policy_settings", "read_file", "saved_policy",
           "to_plain"]  # fmt: skip

Struct = TypeVar("Struct", PPOConfig, SACConfig, TrainConfig, LeagueConfig, Phase)

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Layer:
    """Some settings of one policy, and where they come from."""

    values: Mapping[str, Any]
    where: str


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
            inner = cast(PPOConfig, current)
            changes[name] = lay_over(inner, _mapping(value, name, where), f"{where}: {name}")
        else:
            changes[name] = _fit(value, hints[name], f"{where}: {name}")
    try:
        return dataclasses.replace(config, **changes)
    except ConfigError as error:
        raise ConfigError(f"{where}: {error.message}", error.hint) from None


def policy_settings(
    config: TrainConfig,
    policy: PolicySpec,
    file: Mapping[str, Any] | None = None,
    algorithm: str | None = None,
) -> PolicyConfig:
    """Return one policy's settings: defaults, then its scene, then ``config`` or ``file``.

    Args:
        config: Read only without ``file``: what differs from the defaults in ``config.ppo`` or
            ``config.sac`` counts as set; ``config.policies`` wins over all.
        policy: Whose settings; its scene's are in ``policy.settings``.
        file: Plain settings to lay over the scene's instead of ``config``.
        algorithm: Wins over what the layers say; None leaves it to them.

    Raises:
        ConfigError: A setting does not fit; the text names policy and setting.
    """
    if file is None and policy.name in config.policies:
        return config.policies[policy.name]
    layers = [Layer(policy.settings, f"policy {policy.name} (scene)")]
    if file is None:
        algorithm = algorithm or config.algorithm
        of_config = {"ppo": changed_settings(config.ppo), "sac": changed_settings(config.sac)}
    else:
        _fit(file.get("algorithm"), Literal["ppo", "sac"] | None, "file: algorithm")
        layers.append(Layer(_named_algorithm(file), "file"))
        of_config = {name: file.get(name, {}) for name in ALGORITHM_CONFIGS}
        own = _mapping(file.get("policies", {}), "policies", "file").get(policy.name, {})
        where = f"file, policies.{policy.name}"
        layers.append(Layer(_mapping(own, policy.name, where), where))
    if algorithm is not None:
        layers.append(Layer({"algorithm": algorithm}, f"policy {policy.name}"))
    chosen, since = _choose_algorithm(layers)
    source = f"policy {policy.name}" if file is None else "file"
    shared = Layer(_mapping(of_config[chosen], chosen, source), f"{source}, {chosen}")
    layers[1:1] = [shared]
    return _lay_all(chosen, layers, since + (since > 0))


def _named_algorithm(file: Mapping[str, Any]) -> dict[str, Any]:
    return {} if file.get("algorithm") is None else {"algorithm": file["algorithm"]}


def _choose_algorithm(layers: Sequence[Layer]) -> tuple[str, int]:
    """Return the algorithm that the last layer to name one names, and that layer's index."""
    chosen, since = "ppo", 0
    for index, layer in enumerate(layers):
        if "algorithm" in layer.values:
            options = Literal["ppo", "sac"]
            chosen = _fit(layer.values["algorithm"], options, f"{layer.where}: algorithm")
            since = index
    return chosen, since


def _lay_all(algorithm: str, layers: Sequence[Layer], since: int) -> PolicyConfig:
    """Lay ``layers`` over the defaults of an algorithm that the layer ``since`` has chosen.

    Layers before it were written for another algorithm; what only that one knows is left out.
    """
    settings: PolicyConfig = ALGORITHM_CONFIGS[algorithm]()
    for index, layer in enumerate(layers):
        values = dict(layer.values) | {"algorithm": algorithm}
        foreign = [name for name in values if _is_of_another(name, algorithm)]
        if foreign and index < since:
            log.info("%s: %s left out, %s has no such setting", layer.where, foreign, algorithm)
            values = {name: value for name, value in values.items() if name not in foreign}
        elif foreign:
            raise ConfigError(
                f"{layer.where}: {foreign[0]} is no setting of {algorithm}, which this policy uses",
                "set algorithm as well, or leave that setting out",
            )
        settings = lay_over(cast(PPOConfig, settings), values, layer.where)
    return settings


def _is_of_another(name: str, algorithm: str) -> bool:
    known = {kind: {part.name for part in dataclasses.fields(of)}
             for kind, of in ALGORITHM_CONFIGS.items()}  # fmt: skip
    return name not in known[algorithm] and any(name in names for names in known.values())


def saved_policy(values: Mapping[str, Any], where: str) -> PolicyConfig:
    """Return the settings of one policy from those a run saved."""
    algorithm, _ = _choose_algorithm([Layer(values, where)])
    return _lay_all(algorithm, [Layer(values, where)], 0)


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


def to_plain(config: PolicyConfig | TrainConfig) -> dict[str, Any]:
    """Return ``config`` as JSON values; :func:`lay_over` takes them back."""
    plain = json.dumps(dataclasses.asdict(config), default=str)
    return cast(dict[str, Any], json.loads(plain))


def changed_settings(config: PolicyConfig) -> dict[str, Any]:
    """Return the settings that differ from the defaults."""
    defaults = to_plain(type(config)())
    return {name: value for name, value in to_plain(config).items() if value != defaults[name]}


def _lay_over_policies(config: TrainConfig, value: Any, where: str) -> dict[str, PolicyConfig]:
    """Lay settings of single policies over what ``config`` says of them, or of all."""
    policies = dict(config.policies)
    for name, settings in _mapping(value, "policies", where).items():
        place = f"{where}: policies.{name}"
        own = Layer(_mapping(settings, name, place), place)
        base = policies.get(name)
        named = base.algorithm if base is not None else config.algorithm or "ppo"
        chosen, since = _choose_algorithm([Layer({"algorithm": named}, place), own])
        before = base or (config.sac if chosen == "sac" else config.ppo)
        layers = [Layer(changed_settings(before), place), own]
        policies[name] = _lay_all(chosen, layers, since)
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
