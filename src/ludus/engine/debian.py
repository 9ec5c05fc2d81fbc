"""Route 5: Debian's own packages, unpacked into a folder of the user.

No root is needed and nothing on the system changes. The libraries that come along are newer
than those of a stable system; therefore the engine is started through the loader that lies
beside it, by a small launcher script.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ludus.engine.apt import unpack_packages
from ludus.engine.kinds import EngineKind
from ludus.engine.prefix import find_program, write_launcher
from ludus.engine.routes import Progress, UnpackedEngine

__all__ = ["DebianRoute"]

_PACKAGES = {EngineKind.GODOT4: ("godot",), EngineKind.GODOT3: ("godot3-server",)}
_WINDOW_PACKAGES = {EngineKind.GODOT4: (), EngineKind.GODOT3: ("godot3",)}
_RENDERING_PACKAGES = (
    "libegl1",
    "libegl-mesa0",
    "libgl1",
    "libglx-mesa0",
    "libgl1-mesa-dri",
    "libvulkan1",
    "mesa-vulkan-drivers",
)


@dataclass(frozen=True)
class DebianRoute:
    """Unpacks Debian packages into a private prefix."""

    name: str = "debian"

    def unpack(
        self, kind: EngineKind, folder: Path, *, rendering: bool, progress: Progress
    ) -> UnpackedEngine:
        """Fetch and unpack the packages and write the launchers; see `Route`."""
        packages = _PACKAGES[kind]
        if rendering:
            packages += _WINDOW_PACKAGES[kind] + _RENDERING_PACKAGES
        prefix = unpack_packages(packages, folder, progress)
        return _launchers(kind, folder, prefix, rendering)


def _launchers(kind: EngineKind, folder: Path, prefix: Path, rendering: bool) -> UnpackedEngine:
    headless_names = {EngineKind.GODOT4: "godot", EngineKind.GODOT3: "godot3-server"}
    window_names = {EngineKind.GODOT4: "godot", EngineKind.GODOT3: "godot3"}
    launcher = folder / "godot"
    write_launcher(launcher, prefix, find_program(prefix, headless_names[kind]))
    if not rendering or headless_names[kind] == window_names[kind]:
        return UnpackedEngine(launcher, launcher, rendering)
    window = folder / "godot-window"
    write_launcher(window, prefix, find_program(prefix, window_names[kind]))
    return UnpackedEngine(launcher, window, rendering)
