"""The kinds of game engine that Ludus can find and install."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

__all__ = ["EngineKind", "EngineTraits"]

Version = tuple[int, ...]


@dataclass(frozen=True)
class EngineTraits:
    """What differs between two kinds of engine.

    Attributes:
        label: Name for messages.
        minimum_version: Oldest version that Ludus supports; also fixes the major version.
        environment_variable: Variable in which users name their own executable.
        path_names: Names of the executable on ``PATH``, best first.
    """

    label: str
    minimum_version: Version
    environment_variable: str
    path_names: tuple[str, ...]

    @property
    def requirement(self) -> str:
        """What a refused version should have been, for messages."""
        return f"{self.label} needs {'.'.join(map(str, self.minimum_version))} or newer"


class EngineKind(StrEnum):
    """An engine that must be installed to run a project.

    Exported games and Bevy games are executables and need none of these.
    """

    GODOT4 = "godot4"
    GODOT3 = "godot3"

    @property
    def traits(self) -> EngineTraits:
        """The properties of this kind."""
        return _TRAITS[self]

    def accepts(self, version: Version) -> bool:
        """Tell whether a version is of this kind's major version and new enough."""
        minimum = self.traits.minimum_version
        return version[:1] == minimum[:1] and version >= minimum


_TRAITS = {
    EngineKind.GODOT4: EngineTraits(
        label="Godot 4",
        minimum_version=(4, 4),
        environment_variable="LUDUS_GODOT",
        path_names=("godot4", "godot"),
    ),
    EngineKind.GODOT3: EngineTraits(
        label="Godot 3",
        minimum_version=(3, 5),
        environment_variable="LUDUS_GODOT3",
        path_names=("godot3-server", "godot3", "godot"),
    ),
}
