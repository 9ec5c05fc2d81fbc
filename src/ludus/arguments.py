"""Arguments of public functions, held to their annotations.

What a script gets wrong is an :class:`~ludus.errors.ArgumentError` that names the argument, not an
error from somewhere inside.
"""

from __future__ import annotations

import functools
import inspect
import os
import types
import typing
from collections.abc import Callable, Iterable
from numbers import Integral, Real
from pathlib import Path
from typing import Any, TypeVar

from ludus.errors import ArgumentError

__all__ = ["check_arguments"]

F = TypeVar("F", bound=Callable[..., Any])

_KINDS: dict[Any, tuple[type, str]] = {
    bool: (bool, "True or False"),
    str: (str, "a text"),
    Path: (os.PathLike, "a path"),
    int: (Integral, "a whole number"),
    float: (Real, "a number"),
    types.NoneType: (types.NoneType, "None"),
}
"""What an annotation accepts, and how it is called; True and False count as no number."""


def check_arguments(function: F) -> F:
    """Refuse arguments that are not what the function's annotations say.

    Types of one's own and ``Any`` accept everything, as do the elements of collections but lists.

    Raises:
        ArgumentError: On a call; the text says what was expected.
    """
    signature = inspect.signature(function)
    hints = functools.cache(lambda: typing.get_type_hints(function))

    @functools.wraps(function)
    def checked(*args: Any, **kwargs: Any) -> Any:
        try:
            given = signature.bind(*args, **kwargs).arguments
        except TypeError:
            return function(*args, **kwargs)  # Python says what is missing or unknown
        for name, value in given.items():
            is_open = signature.parameters[name].kind is inspect.Parameter.VAR_KEYWORD
            hint = Any if is_open else hints().get(name, Any)
            if not _fits(value, hint):
                expected = " or ".join(dict.fromkeys(_describe(hint)))
                raise ArgumentError(
                    f"{function.__name__}: {name} must be {expected}, not {value!r:.80}"
                )
        return function(*args, **kwargs)

    return typing.cast(F, checked)


def _fits(value: Any, hint: Any) -> bool:
    origin, inner = typing.get_origin(hint), typing.get_args(hint)
    if origin in {types.UnionType, typing.Union}:
        return any(_fits(value, one) for one in inner)
    if origin is typing.Literal:
        return any(value is one or (isinstance(value, str) and value == one) for one in inner)
    if hint in _KINDS:
        return isinstance(value, _KINDS[hint][0]) and isinstance(value, bool) == (hint is bool)
    kind: Any = origin or hint
    if not _is_class(kind):
        return True
    is_list = issubclass(list, kind) and bool(inner)
    return isinstance(value, kind) and (not is_list or all(_fits(one, inner[0]) for one in value))


def _describe(hint: Any) -> Iterable[str]:
    origin, inner = typing.get_origin(hint), typing.get_args(hint)
    if origin in {types.UnionType, typing.Union}:
        return [text for one in inner for text in _describe(one)]
    if origin is typing.Literal:
        return map(repr, inner)
    if hint in _KINDS:
        return [_KINDS[hint][1]]
    name = getattr(origin or hint, "__name__", str(hint))
    return [
        {"Mapping": "a dictionary", "Sequence": "a list", "Callable": "a function"}.get(name, name)
    ]


def _is_class(hint: Any) -> bool:
    """Whether ``isinstance`` can tell; of protocols it cannot."""
    return hint is not Any and isinstance(hint, type) and not getattr(hint, "_is_protocol", False)
