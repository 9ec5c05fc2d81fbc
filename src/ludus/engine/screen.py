"""A virtual screen for games that draw, on a Linux machine without a screen.

It is Xvfb: the one on ``PATH``, or the one in the user cache (see `install.install_screen`).
"""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

from ludus.engine.cache import cache_root
from ludus.errors import SetupError

__all__ = ["SCREEN_FOLDER", "find_xvfb", "has_screen", "with_display", "with_virtual_screen"]

SCREEN_FOLDER = "screens"

_HINT = (
    "`ludus engine install godot4 --rendering` installs Xvfb where the machine has apt; otherwise "
    "install it (Debian: apt install xvfb), or run without rendering"
)
# Started with the path of Xvfb as $0 and the game's command as arguments. Each screen has a cookie
# (Xauthority file: any address, any display), so that no other user can draw on it or read it. The
# game runs in the foreground, because a shell lets background programs ignore Ctrl-C.
_SCRIPT = r"""
folder=$(mktemp -d "${TMPDIR:-/tmp}/ludus-screen-XXXXXX") || exit
trap 'kill $server 2> /dev/null; wait $server 2> /dev/null; rm -rf "$folder"' EXIT
trap 'exit 143' TERM
{ printf '\377\377\0\0\0\0\0\22MIT-MAGIC-COOKIE-1\0\20'; head -c 16 /dev/urandom; } \
  > "$folder/authority"
mkfifo "$folder/number" || exit
"$0" -displayfd 3 -screen 0 1920x1200x24 -nolisten tcp -auth "$folder/authority" \
  3> "$folder/number" > "$folder/log" 2>&1 &
server=$!
read -r number < "$folder/number" || { cat "$folder/log"; echo "$0 does not start"; exit 1; }
DISPLAY=":$number" XAUTHORITY="$folder/authority" "$@"
"""


def has_screen() -> bool:
    """Tell whether windows can be opened without a virtual screen."""
    if sys.platform != "linux":
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def find_xvfb() -> Path | None:
    """Return Xvfb, the one on ``PATH`` before the one in the user cache; None if there is none."""
    on_path = shutil.which("Xvfb")
    if on_path is not None:
        return Path(on_path)
    root = cache_root()
    cached = sorted((root / SCREEN_FOLDER).glob("[!.]*/Xvfb")) if root else []
    return cached[-1] if cached else None


def with_display(command: tuple[str, ...]) -> tuple[str, ...]:
    """Give a command that opens a window a virtual screen if there is no real one.

    The screen lasts as long as the command runs. Its exit code is the command's; 128 + n if
    signal n ended it.

    Raises:
        SetupError: There is neither a screen nor Xvfb.
    """
    if has_screen():
        return command
    xvfb = find_xvfb()
    if xvfb is None:
        raise SetupError("the game needs a screen: this machine has neither one nor Xvfb", _HINT)
    return with_virtual_screen(command, xvfb)


def with_virtual_screen(command: tuple[str, ...], xvfb: Path) -> tuple[str, ...]:
    """Give a command its own virtual screen; see `with_display`."""
    return ("/bin/sh", "-c", _SCRIPT, str(xvfb), *command)
