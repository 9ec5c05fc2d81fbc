"""What a sweep varies: ``ppo.learning_rate=log:1e-5:1e-2``."""

from __future__ import annotations

import dataclasses
import json
import types
import typing
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

from ludus.errors import ConfigError, did_you_mean
from ludus.settings.policy_config import PPOConfig, SACConfig
from ludus.settings.train_config import TrainConfig

__all__ = ["FORMS", "Choice", "Domain", "Range", "nest", "read_space"]

FORMS = "NAME=LOW:HIGH, NAME=log:LOW:HIGH or NAME=A,B,C"
LOG = "log"


@dataclass(frozen=True)
class Range:
    """All numbers from ``low`` to ``high``.

    Attributes:
        low: The lowest.
        high: The highest.
        is_log: Whether each order of magnitude is as likely as any other.
        is_integer: Whether only whole numbers count.
    """

    low: float
    high: float
    is_log: bool
    is_integer: bool

    def suggest(self, trial: Any, name: str) -> Any:
        """Let a trial of Optuna choose."""
        if self.is_integer:
            return trial.suggest_int(name, int(self.low), int(self.high), log=self.is_log)
        return trial.suggest_float(name, self.low, self.high, log=self.is_log)

    def holds(self, value: Any) -> bool:
        """Return whether this value could be chosen."""
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        return is_number and self.low <= value <= self.high


@dataclass(frozen=True)
class Choice:
    """Some values, each as likely as any other.

    Attributes:
        texts: The values, as JSON.
    """

    texts: tuple[str, ...]

    def suggest(self, trial: Any, name: str) -> Any:
        """Let a trial of Optuna choose."""
        return json.loads(trial.suggest_categorical(name, list(self.texts)))

    def holds(self, value: Any) -> bool:
        """Return whether this value could be chosen."""
        return json.dumps(value) in self.texts


Domain = Range | Choice


def read_space(texts: Mapping[str, str]) -> dict[str, Domain]:
    """Return what a sweep varies, by dotted name of the setting.

    Args:
        texts: ``{"ppo.learning_rate": "log:1e-5:1e-2", "ppo.activation": "tanh,relu"}``.

    Raises:
        ConfigError: A setting is unknown, or its values cannot be read.
    """
    return {name: _read_domain(name, text) for name, text in texts.items()}


def nest(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return values by dotted name as nested settings."""
    nested: dict[str, Any] = {}
    for name, value in values.items():
        *path, last = name.split(".")
        inner = nested
        for part in path:
            inner = inner.setdefault(part, {})
        inner[last] = value
    return nested


def _read_domain(name: str, text: str) -> Domain:
    kinds = _kinds(name)
    parts = text.split(":")
    is_log = parts[0] == LOG
    bounds = parts[1:] if is_log else parts
    if len(bounds) != 2:
        if is_log:
            raise _unreadable(name, text)
        return Choice(tuple(json.dumps(value) for value in _read_values(text)))
    try:
        low, high = map(float, bounds)
    except ValueError:
        raise _unreadable(name, text) from None
    if not kinds & {int, float}:
        raise ConfigError(f"--set {name}={text}: {name} is not a number", f"write {name}=A,B,C")
    if not low < high or (is_log and low <= 0):
        above = " above 0" if is_log else ""
        raise ConfigError(f"--set {name}={text}: the bounds must be LOW{above}, then HIGH")
    return Range(low, high, is_log, is_integer=float not in kinds)


def _read_values(text: str) -> list[Any]:
    """Return values as JSON has them; what is no JSON is a list of texts."""
    try:
        return cast(list[Any], json.loads(f"[{text}]"))
    except json.JSONDecodeError:
        return text.split(",")


def _unreadable(name: str, text: str) -> ConfigError:
    return ConfigError(f"--set {name}={text} cannot be read", f"write {FORMS}")


def _kinds(name: str) -> set[type]:
    """Return the types that the setting called ``name`` may have."""
    head, _, rest = name.partition(".")
    owners: list[type] = [TrainConfig]
    known = _hints(TrainConfig)
    last = head
    if head == "policies" and rest.count(".") == 1:
        owners, last = [PPOConfig, SACConfig], rest.partition(".")[2]
    elif rest and dataclasses.is_dataclass(known.get(head)):
        owners, last = [known[head]], rest
    hints = {setting: hint for owner in owners for setting, hint in _hints(owner).items()}
    if last not in hints or dataclasses.is_dataclass(hints[last]):
        prefix = name.removesuffix(last)
        raise ConfigError(
            f"--set {name}: there is no such setting",
            did_you_mean(name, [f"{prefix}{setting}" for setting in hints], "settings"),
        )
    hint = hints[last]
    is_union = typing.get_origin(hint) in {types.UnionType, typing.Union}
    return set(typing.get_args(hint) if is_union else (hint,))


def _hints(owner: Any) -> dict[str, Any]:
    return typing.get_type_hints(owner)
