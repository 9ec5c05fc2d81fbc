"""Settings of bridges as a command line or a settings file has them: texts.

A space is written as in Python, ``Box(-2, 2, (1,))``. It is taken apart and made anew: nothing that
is written here runs.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any, cast, get_args

import numpy as np
from gymnasium import spaces

from ludus.errors import ConfigError
from ludus.folder_imports import look_in_current_folder

__all__ = ["parse_space", "read_setting"]

_SPACES = {
    kind.__name__: kind
    for kind in (
        spaces.Discrete,
        spaces.Box,
        spaces.MultiDiscrete,
        spaces.MultiBinary,
        spaces.Dict,
    )
}
_NUMBERS = {"inf": math.inf, "pi": math.pi}
_DTYPES = {"float32", "float64", "int8", "int16", "int32", "int64", "uint8", "bool"}
_OPERATORS: dict[type[ast.operator], Callable[[float, float], float]] = {
    ast.Add: lambda left, right: left + right,
    ast.Sub: lambda left, right: left - right,
    ast.Mult: lambda left, right: left * right,
    ast.Div: lambda left, right: left / right,
}
_MAX_CHARACTERS = 10_000


def parse_space(name: str, text: str) -> spaces.Space[Any]:
    """Return the space that a text describes.

    >>> parse_space("action_space", "Box(-2, 2, (1,))")
    Box(-2.0, 2.0, (1,), float32)

    Args:
        name: The setting, for messages.
        text: ``Discrete``, ``Box``, ``MultiDiscrete``, ``MultiBinary`` or a ``Dict`` of them, with
            numbers, ``inf``, ``pi``, ``+ - * /``, lists, tuples, and dtypes such as ``uint8``.

    Raises:
        ConfigError: It describes no such space.
    """
    hint = f'such as "Discrete(2)" or "Box(-1, 1, (3,))"; there are {", ".join(_SPACES)}'
    try:
        if len(text) > _MAX_CHARACTERS:
            raise ValueError(f"it has more than {_MAX_CHARACTERS} characters")
        value = _value_of(ast.parse(text.strip(), mode="eval").body)
    except SyntaxError as error:
        raise ConfigError(f"{name} {text!r} cannot be read: {error.msg}", hint) from None
    except (
        ArithmeticError,
        AssertionError,
        AttributeError,
        LookupError,
        MemoryError,
        RecursionError,
        TypeError,
        ValueError,
    ) as error:
        raise ConfigError(f"{name} {text!r} cannot be read: {error}", hint) from None
    if not isinstance(value, spaces.Space):
        raise ConfigError(f"{name} must be one of {', '.join(_SPACES)}, got {text!r}", hint)
    return cast("spaces.Space[Any]", value)


def _value_of(node: ast.expr) -> Any:  # noqa: PLR0911 - a table of forms
    match node:
        case ast.Constant(value=int() | float() | str() as value):
            return value
        case ast.Name(id=name) | ast.Attribute(value=ast.Name(id="np" | "math"), attr=name):
            return _named(name)
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return -_value_of(operand)
        case ast.BinOp(left=left, op=sign, right=right) if type(sign) in _OPERATORS:
            return _OPERATORS[type(sign)](_number(left), _number(right))
        case ast.List(elts=items):
            return [_value_of(item) for item in items]
        case ast.Tuple(elts=items):
            return tuple(_value_of(item) for item in items)
        case ast.Dict(keys=keys, values=values) if None not in keys:
            return {
                _value_of(cast(ast.expr, key)): _value_of(value)
                for key, value in zip(keys, values, strict=True)
            }
        case ast.Call(func=called, args=positional, keywords=named):
            values = {str(one.arg): _value_of(one.value) for one in named}
            return _make(_name_of(called), [_value_of(one) for one in positional], values)
        case _:
            raise ValueError(f"{ast.unparse(node)} has no place in a space")


def _number(node: ast.expr) -> float:
    value = _value_of(node)
    if isinstance(value, int | float):
        return value
    raise ValueError(f"{ast.unparse(node)} is not a number")


def _named(name: str) -> Any:
    if name in _NUMBERS:
        return _NUMBERS[name]
    if name in _DTYPES:
        return name
    raise ValueError(f"{name} is unknown")


def _name_of(called: ast.expr) -> str:
    """Return the last part of ``Box``, ``spaces.Box`` or ``gymnasium.spaces.Box``."""
    return ast.unparse(called).rpartition(".")[2]


def _make(name: str, positional: list[Any], named: dict[str, Any]) -> spaces.Space[Any]:
    if name not in _SPACES:
        raise ValueError(f"there is no space {name}")
    if name != "Box":
        return cast("spaces.Space[Any]", _SPACES[name](*positional, **named))
    if len(positional) > 4:
        raise ValueError("Box takes low, high, shape and dtype")
    values = dict(zip(("low", "high", "shape", "dtype"), positional, strict=False)) | named
    dtype = np.dtype(values.pop("dtype", "float32"))
    bounds = {
        bound: np.array(values.pop(bound), dtype)
        if isinstance(values.get(bound), list)
        else values.pop(bound)
        for bound in ("low", "high")
    }
    return spaces.Box(**bounds, **values, dtype=cast(Any, dtype))


def read_setting(name: str, text: str, hint: Any) -> Any:
    """Return a setting that was written as a text.

    Args:
        name: The setting.
        text: As written: a space, a number, true or false, ``HOST:PORT`` of an address,
            ``MODULE:NAME`` of a function, ``MODULE`` of a module, or a dictionary as in JSON.
        hint: Type of the setting.

    Raises:
        ConfigError: The text does not fit.
    """
    if name.endswith("_space"):
        return parse_space(name, text)
    if name.endswith("_module"):
        return _import(name, text)
    if name.endswith("_address"):
        host, _, port = text.rpartition(":")
        if not host or not port.isdecimal():
            raise ConfigError(f"{name} is {text!r}, expected HOST:PORT")
        return host, int(port)
    kinds = get_args(hint) or (hint,)
    if "Callable" in str(hint):
        module, _, function = text.partition(":")
        return _attribute(name, _import(name, module), function or name)
    return _read_value(name, text, kinds)


def _read_value(name: str, text: str, kinds: tuple[Any, ...]) -> Any:
    if str in kinds:
        return text
    try:
        words = {"true": True, "false": False, "none": None, "null": None}
        value: Any = words[text.lower()] if text.lower() in words else ast.literal_eval(text)
    except (ValueError, SyntaxError, MemoryError, RecursionError):
        value = text
    if float in kinds and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    names = {bool: "true or false", int: "a whole number", float: "a number"}
    allowed = tuple(kind for kind in kinds if kind in (bool, int, float))
    is_text = isinstance(value, str) or (isinstance(value, bool) and bool not in kinds)
    if allowed and (is_text or not isinstance(value, (*allowed, type(None)))):
        raise ConfigError(f"{name} must be {names[allowed[0]]}, not {text!r}")
    if not allowed and not isinstance(value, Mapping | None):
        raise ConfigError(f"{name} must be a dictionary, not {text!r}")
    return cast(Any, value)


def _import(name: str, module: str) -> Any:
    look_in_current_folder(module)
    try:
        return import_module(module)
    except (ImportError, ValueError) as error:
        raise ConfigError(
            f"{name}: there is no module {module!r}: {error}",
            hint="MODULE:NAME names a function in MODULE.py of the current folder",
        ) from None


def _attribute(name: str, module: Any, function: str) -> Any:
    try:
        return getattr(module, function)
    except AttributeError:
        raise ConfigError(
            f"{name}: module {module.__name__} has no {function}",
            hint="MODULE:NAME names a function",
        ) from None
