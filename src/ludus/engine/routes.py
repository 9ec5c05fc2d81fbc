"""What an installation route is: something that unpacks into an empty folder.

There are routes to engines, and routes to export templates.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from ludus.engine.kinds import EngineKind

__all__ = [
    "Progress",
    "Route",
    "RouteUnavailable",
    "TemplateRoute",
    "UnpackedEngine",
    "UnpackedTemplate",
    "no_progress",
]

Progress = Callable[[str, float | None], None]
"""Called with what is being done and, where known, the fraction done in [0, 1]."""


def no_progress(_what: str, _fraction: float | None) -> None:
    """Tell nobody."""


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


@dataclass(frozen=True)
class UnpackedTemplate:
    """Where a route put an export template.

    Attributes:
        executable: What Godot copies when it exports a game.
        runnable: A way to start it here: a launcher, or the executable itself.
        prefix: The libraries that games made of it need to start on this machine; None if
            those of the system do.
    """

    executable: Path
    runnable: Path
    prefix: Path | None = None


class TemplateRoute(Protocol):
    """A way to obtain an export template."""

    @property
    def name(self) -> str:
        """Short name, part of the folder's name in the cache."""
        ...

    def unpack_template(
        self, release: str, folder: Path, *, progress: Progress
    ) -> UnpackedTemplate:
        """Put the export template for Linux games into ``folder``, which can be moved afterwards.

        Args:
            release: What it should fit, such as ``4.6.3.stable``; the caller checks that.
            folder: An empty folder.
            progress: Called with what is being done.

        Raises:
            RouteUnavailable: The machine cannot use this route, or it has another release.
            SetupError: The route could be used, and failed.
        """
        ...
