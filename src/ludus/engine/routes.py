"""What an installation route is: something that unpacks an engine into an empty folder."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from ludus.engine.kinds import EngineKind

__all__ = ["Progress", "Route", "RouteUnavailable", "UnpackedEngine"]

Progress = Callable[[str, float | None], None]
"""Called with what is being done and, where known, the fraction done in [0, 1]."""


class RouteUnavailable(Exception):  # noqa: N818 - reads as what happened
    """This machine cannot use the route (no network, no ``apt``…): try the next one."""


@dataclass(frozen=True)
class UnpackedEngine:
    """Where a route put the executables.

    Attributes:
        executable: The one that runs without a window.
        window_executable: The one that opens a window; often the same.
        has_rendering: Whether a window can be opened.
    """

    executable: Path
    window_executable: Path
    has_rendering: bool


class Route(Protocol):
    """A way to obtain an engine."""

    @property
    def name(self) -> str:
        """Short name, part of the folder's name in the cache."""
        ...

    def unpack(
        self, kind: EngineKind, folder: Path, *, rendering: bool, progress: Progress
    ) -> UnpackedEngine:
        """Put a working engine into ``folder``, which can be moved afterwards.

        Raises:
            RouteUnavailable: The machine cannot use this route.
            SetupError: The route could be used, and failed.
        """
        ...
