"""Policies as JSON files, ``*.ludus.json`` (protocol/POLICY.md §1).

The keys of the file are the fields of :mod:`ludus.model.policy_model`, so one writer and one reader
that follow the types of those fields serve all parts. Errors name the field.
"""

from __future__ import annotations

import base64
import dataclasses
import json
import math
import sys
import types
import typing
from collections.abc import Mapping
from pathlib import Path
from reprlib import repr as short
from typing import Any, Literal, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from ludus.disk import write_atomically
from ludus.errors import PolicyFileError, ProtocolError
from ludus.model.checking import MAX_PARAMETERS, check_model, mismatch
from ludus.model.policy_model import PolicyModel
from ludus.spec import ContinuousAction, DiscreteAction, ObservationEntry, PolicySpec
from ludus.wire.frames import parse_json
from ludus.wire.spec_reader import read_spec

__all__ = ["MAX_FILE_BYTES", "from_json", "read_model", "to_json", "write_model"]

FORMAT, VERSION = "ludus-policy", 1
MAX_FILE_BYTES = 1 << 28
MAX_ITEMS, MAX_DIMENSIONS = 64, 4

Part = TypeVar("Part")


@dataclasses.dataclass(frozen=True)
class _Tensor:
    """An array in the file; the data are float32 in base64."""

    shape: tuple[int, ...]
    data: str


def read_model(path: str | Path) -> PolicyModel:
    """Read a policy file.

    Raises:
        PolicyFileError: The file is missing, too large, malformed, or its parts do not fit each
            other; the message names path and field.
    """
    path = Path(path)
    try:
        with path.open("rb") as file:
            data = file.read(MAX_FILE_BYTES + 1)
    except OSError as error:
        raise PolicyFileError(
            f"cannot read policy file {path}: {error.strerror}",
            hint="name a run folder (`ludus runs` lists them), a .ludus.json or an .onnx file",
        ) from error
    if len(data) > MAX_FILE_BYTES:
        raise PolicyFileError(f"{path}: more than {MAX_FILE_BYTES} bytes")
    try:
        return from_json(parse_json(data))
    except ValueError as error:
        hint = "`ludus export` writes policy files"
        if path.suffix == ".onnx":
            hint = "only ludus.load_policy plays .onnx files: name the run, or its .ludus.json"
        raise PolicyFileError(f"{path}: not JSON: {error}", hint) from error
    except PolicyFileError as error:
        raise PolicyFileError(f"{path}: {error.message}", error.hint) from error


def write_model(path: str | Path, model: PolicyModel) -> None:
    """Write a policy file; readers see the old one or the new one, whatever happens.

    Raises:
        PolicyFileError: The model contradicts itself, or the file cannot be written.
    """
    path = Path(path)
    text = json.dumps(to_json(model), separators=(",", ":"), allow_nan=False) + "\n"
    try:
        write_atomically(path, text.encode())
    except OSError as error:
        raise PolicyFileError(f"cannot write policy file {path}: {error.strerror}") from error


# --- writing ------------------------------------------------------------------------------------


def to_json(model: PolicyModel) -> dict[str, Any]:
    """Return the object of POLICY.md §1.

    Raises:
        PolicyFileError: The model contradicts itself.
    """
    check_model(model)
    return {"format": FORMAT, "version": VERSION, **_to_plain(model)}


def _to_plain(value: Any) -> Any:
    """Return a part of a model as JSON values."""
    if isinstance(value, np.ndarray):
        array = np.ascontiguousarray(cast(NDArray[Any], value), "<f4")
        data = base64.b64encode(array.tobytes()).decode("ascii")
        return {"shape": list(array.shape), "data": data}
    if isinstance(value, ObservationEntry | DiscreteAction | ContinuousAction):
        return value.to_json()
    if isinstance(value, tuple):
        return [_to_plain(item) for item in cast(tuple[Any, ...], value)]
    if dataclasses.is_dataclass(value):
        names = (field.name for field in dataclasses.fields(value))
        return {name: _to_plain(getattr(value, name)) for name in names}
    return value


# --- reading ------------------------------------------------------------------------------------


def from_json(value: Any) -> PolicyModel:
    """Build a model from the JSON of a policy file.

    Raises:
        PolicyFileError: A field is missing, of the wrong type or over a limit, or does not fit the
            others.
    """
    file = _object(value, "")
    if _get(file, "format", "") != FORMAT:
        raise mismatch("format", f'"{FORMAT}"', short(file["format"]))
    version = _get(file, "version", "")
    if version != VERSION:
        is_newer = _is_number(version) and version > VERSION
        raise PolicyFileError(
            f"policy file: version: expected {VERSION}, got {short(version)}",
            hint="upgrade ludus" if is_newer else "export again",
        )
    spec = _read_spec(file)
    file = {"frames": 1, **file}  # older files have one, and do not say so
    declared = {
        "policy": spec.name,
        "observation": spec.observation,
        "action": spec.action,
        "has_action_mask": spec.has_action_mask,
    }
    model = _read_part(PolicyModel, file, "", declared)
    check_model(model)
    return model


def _read_spec(file: Mapping[str, Any]) -> PolicySpec:
    """Read policy, entries and components as those of a handshake with one agent."""
    policy: dict[str, Any] = {
        "name": _get(file, "policy", ""),
        "observation": _get(file, "observation", ""),
        "action": _get(file, "action", ""),
        "has_action_mask": _get(file, "has_action_mask", ""),
        "num_agents": 1,
        "agents_per_world": 1,
        "episode": "agent",
        "max_episode_steps": None,
        "agents": [{"world": 0, "path": None}],
        "settings": {},
    }
    worlds = {"num_worlds": 1, "layout": "isolated", "ticks_per_step": 1, "tick_rate": 1.0}
    try:
        return read_spec({**worlds, "policies": [policy]}).policies[0]
    except ProtocolError as error:
        what = error.message.removeprefix("spec.policies[0].")
        raise PolicyFileError(f"policy file: {what}", hint="export the policy again") from error


def _read_part(
    kind: type[Part], value: Any, where: str, known: Mapping[str, Any] | None = None
) -> Part:
    """Read an object as a dataclass, but for the fields that are ``known``."""
    part, fields = _object(value, where), dict(known or {})
    for name, hint in typing.get_type_hints(kind).items():
        if name not in fields:
            place = f"{where}.{name}" if where else name
            fields[name] = _read(_get(part, name, where), hint, place)
    return kind(**fields)


def _read(value: Any, hint: Any, where: str) -> Any:  # noqa: PLR0911 - a table of types
    """Return a JSON value as the type ``hint`` of a field."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin is types.UnionType:  # with None
        return None if value is None else _read(value, arguments[0], where)
    if origin is np.ndarray:
        return _read_array(value, where)
    if origin is tuple:
        return _read_tuple(value, arguments, where)
    if dataclasses.is_dataclass(hint):
        return _read_part(cast(type[Any], hint), value, where)
    if origin is Literal:
        if value in arguments:
            return value
        names = ", ".join(arguments)
        raise mismatch(where, f"one of {names}" if arguments[1:] else f'"{names}"', short(value))
    if hint in {float, int}:
        return _read_number(value, hint, where)
    if not isinstance(value, hint):
        expected = "true or false" if hint is bool else "a text"
        raise mismatch(where, expected, short(value))
    return value


def _read_number(value: Any, kind: type[int] | type[float], where: str) -> float:
    if not _is_number(value) or not abs(value) <= sys.float_info.max:
        raise mismatch(where, "a finite number", short(value))
    if kind is int and value != value // 1:  # 1.0 is an integer: Godot writes every number so
        raise mismatch(where, "an integer", short(value))
    return kind(value)


def _read_tuple(value: Any, items: tuple[Any, ...], where: str) -> tuple[Any, ...]:
    if not isinstance(value, list):
        raise mismatch(where, "a list", short(value))
    values = cast(list[Any], value)
    if items[-1] is not Ellipsis and len(values) != len(items):
        raise mismatch(where, f"{len(items)} items", short(values))
    if len(values) > MAX_ITEMS:
        raise mismatch(where, f"at most {MAX_ITEMS} items", len(values))
    return tuple(_read(item, items[0], f"{where}[{i}]") for i, item in enumerate(values))


def _read_array(value: Any, where: str) -> NDArray[np.float32]:
    tensor = _read_part(_Tensor, value, where)
    shape, size = tensor.shape, math.prod(tensor.shape)
    if not 1 <= len(shape) <= MAX_DIMENSIONS or min(shape) < 0 or size > MAX_PARAMETERS:
        expected = f"1 to {MAX_DIMENSIONS} sizes of at most {MAX_PARAMETERS} numbers"
        raise mismatch(f"{where}.shape", expected, list(shape))
    try:
        data = base64.b64decode(tensor.data, validate=True)
    except ValueError as error:
        raise mismatch(f"{where}.data", "base64", error) from error
    if len(data) != 4 * size:
        raise mismatch(f"{where}.data", f"{4 * size} bytes for {list(shape)} float32", len(data))
    return np.frombuffer(data, "<f4").reshape(shape).astype(np.float32)


def _object(value: Any, where: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise mismatch(where or "the whole", "an object", type(value).__name__)
    return cast(dict[str, Any], value)


def _get(part: Mapping[str, Any], name: str, where: str) -> Any:
    if name not in part:
        raise mismatch(f"{where}.{name}" if where else name, "a value", "nothing")
    return part[name]


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
