"""Install Xvfb in the user cache, for virtual screens; see `screen`.

It comes from Debian's packages, like the engines of route 5. Xvfb looks for two things in fixed
places of the system, and has no option for them: the compiler of keyboard layouts, without which
it does not start, and Mesa's driver, without which OpenGL does not work. In the copy these two
paths are replaced by shorter ones, relative to the folder in which the launcher starts it.
"""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from ludus.engine.apt import unpack_packages
from ludus.engine.cache import require_cache_root
from ludus.engine.incoming import installing_into, move_in, unpack_by_first_route
from ludus.engine.launcher import find_program, library_folders, write_launcher
from ludus.engine.routes import Progress, RouteUnavailable, no_progress
from ludus.engine.screen import SCREEN_FOLDER, find_xvfb, with_virtual_screen
from ludus.errors import SetupError

__all__ = ["install_screen", "replace_path"]

START_TIMEOUT_S = 30.0

_PACKAGES = ("xvfb", "x11-xkb-utils", "xkb-data")
_IN_OWN_FOLDER = """\
cd -- "$prefix/.." || exit
set -- -xkbdir "$prefix/usr/share/X11/xkb" "$@"
"""


def install_screen(*, force: bool = False, progress: Progress = no_progress) -> Path:
    """Install Xvfb, or return the one that is on ``PATH`` or was installed already.

    Args:
        force: Install again even if it is there.
        progress: Called with what is being done.

    Raises:
        SetupError: This machine has no apt, or the installation failed; nothing is left behind.
    """
    folder = require_cache_root() / SCREEN_FOLDER
    with installing_into(folder, "Xvfb"):
        present = None if force else find_xvfb()
        return present or _install(folder, progress)


@dataclass(frozen=True)
class _DebianPackages:
    name: str = "debian"

    def unpack(self, folder: Path, progress: Progress) -> None:
        """Fetch and unpack the packages, and write the launchers of what they bring.

        Raises:
            RouteUnavailable: This machine does not run Linux, or cannot reach a Debian mirror.
            SetupError: It failed.
        """
        if sys.platform != "linux":
            raise RouteUnavailable("this machine does not run Linux")
        prefix = unpack_packages(_PACKAGES, folder, progress)
        libraries = library_folders(prefix)[0]
        (folder / "dri").symlink_to(Path(prefix.name) / libraries / "dri")
        write_launcher(folder / "xkbcomp", prefix, find_program(prefix, ["xkbcomp"]))
        server = find_program(prefix, ["Xvfb"])
        replace_path(server, "/usr/bin", ".")
        replace_path(server, f"/{libraries}/dri", "dri")
        write_launcher(folder / "Xvfb", prefix, server, setup=_IN_OWN_FOLDER)


def _install(folder: Path, progress: Progress) -> Path:
    def unpack(route: _DebianPackages, incoming: Path) -> Path:
        route.unpack(incoming, progress)
        _try_out(incoming / "Xvfb")
        return move_in(incoming, folder / f"xvfb-{route.name}") / "Xvfb"

    failure = SetupError(
        "Xvfb could not be installed", hint="install it yourself (Debian: apt install xvfb)"
    )
    return unpack_by_first_route([_DebianPackages()], folder, unpack, failure)


def replace_path(program: Path, old: str, new: str) -> None:
    """Replace a path that is a string constant of an executable by one that is not longer."""
    data = program.read_bytes()
    before = b"\0" + old.encode() + b"\0"
    if data.count(before) != 1:
        raise SetupError(f"{program.name} has {data.count(before)} times the path {old}, not once")
    after = b"\0" + new.encode().ljust(len(old) + 1, b"\0")
    program.write_bytes(data.replace(before, after))


def _try_out(xvfb: Path) -> None:
    """Open a screen once."""
    try:
        done = subprocess.run(
            with_virtual_screen(("true",), xvfb),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            timeout=START_TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise SetupError(f"the installed Xvfb does not start in {START_TIMEOUT_S:.0f} s") from error
    if done.returncode != 0:
        raise SetupError(f"the installed Xvfb does not start:\n{done.stdout}")
