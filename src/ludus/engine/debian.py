"""Install Debian's own packages, unpacked into a folder of the user.

No root is needed and nothing on the system changes. The libraries of the packages are newer than
those of a stable system, so a small launcher script starts each program through the loader
unpacked with it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from ludus.engine.apt import unpack_packages
from ludus.engine.installing import Progress, Unpacked
from ludus.engine.kinds import EngineKind
from ludus.engine.prefix import (
    find_program,
    library_folders,
    remove_library_paths,
    replace_path,
    write_launcher,
)

__all__ = ["SCREEN", "DebianInstaller", "debian_engine", "debian_template"]

_MESA = (
    "libegl1",
    "libegl-mesa0",
    "libgl1",
    "libglx-mesa0",
    "libgl1-mesa-dri",
    "libvulkan1",
    "mesa-vulkan-drivers",
)
_IN_OWN_FOLDER = """\
cd -- "$prefix/.." || exit
set -- -xkbdir "$prefix/usr/share/X11/xkb" "$@"
"""


@dataclass(frozen=True)
class DebianInstaller:
    """Unpacks Debian packages, with all they depend on, into a private prefix.

    Attributes:
        packages: Names of packages.
        launchers: Programs of the prefix by the name of the launcher that starts each; the first
            is the product, the last one opens windows.
        has_rendering: Whether the product can open a window.
        adapt: Gets the prefix, and changes it before the launchers are written.
        setup: Lines of shell that the launchers run first; see `write_launcher`.
    """

    packages: tuple[str, ...]
    launchers: Mapping[str, str]
    has_rendering: bool = False
    adapt: Callable[[Path], None] | None = None
    setup: str = ""
    name: str = "debian"

    def unpack(self, folder: Path, progress: Progress) -> Unpacked:
        """Fetch and unpack the packages and write the launchers; see `Installer`."""
        prefix = unpack_packages(self.packages, folder, progress)
        if self.adapt is not None:
            self.adapt(prefix)
        programs = {
            folder / launcher: find_program(prefix, program)
            for launcher, program in self.launchers.items()
        }
        for launcher, program in programs.items():
            write_launcher(launcher, prefix, program, self.setup)
        paths = list(programs)
        return Unpacked(paths[0], programs[paths[0]], paths[-1], self.has_rendering, prefix)


def debian_engine(kind: EngineKind, rendering: bool) -> DebianInstaller:
    """Return the installer of an engine."""
    if kind is EngineKind.GODOT4:
        packages, launchers = ("godot",), {"godot": "godot"}
    elif rendering:
        packages = ("godot3-server", "godot3")
        launchers = {"godot": "godot3-server", "godot-window": "godot3"}
    else:
        packages, launchers = ("godot3-server",), {"godot": "godot3-server"}
    return DebianInstaller(packages + (_MESA if rendering else ()), launchers, rendering)


def debian_template(kind: str = "release") -> DebianInstaller:
    """Return the installer of the export template; Debian has one version at a time.

    Games made from it need the libraries of its prefix; `prefix.bind_to_prefix` makes them use
    those.

    Args:
        kind: ``release`` or ``debug``.
    """
    template = f"godot-template-{kind}"
    return DebianInstaller((template, "patchelf"), {"template": template}, adapt=_adapt_template)


def _adapt_template(prefix: Path) -> None:
    # These paths are in a folder of the system, where an exported game must not look.
    remove_library_paths(prefix, "libpulse*.so.*")


def _adapt_screen(prefix: Path) -> None:
    """Let Xvfb find in its own folder what it looks for at fixed paths of the system.

    It has no option for these paths: that of the compiler of keyboard layouts, without which it
    does not start, and that of Mesa's driver, without which OpenGL does not work. They are
    replaced by shorter ones, relative to the folder in which the launcher starts it.
    """
    folder, libraries = prefix.parent, library_folders(prefix)[0]
    (folder / "dri").symlink_to(Path(prefix.name) / libraries / "dri")
    write_launcher(folder / "xkbcomp", prefix, find_program(prefix, "xkbcomp"))
    server = find_program(prefix, "Xvfb")
    replace_path(server, "/usr/bin", ".")
    replace_path(server, f"/{libraries}/dri", "dri")


SCREEN = DebianInstaller(
    ("xvfb", "x11-xkb-utils", "xkb-data"),
    {"Xvfb": "Xvfb"},
    adapt=_adapt_screen,
    setup=_IN_OWN_FOLDER,
)
"""The installer of Xvfb."""
