"""The export template of Debian's own packages.

Games made of it need the libraries of Debian's unstable suite. They are unpacked beside it, and
`prefix` makes a game use them from there.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

from ludus.engine.apt import unpack_packages
from ludus.engine.prefix import find_program, remove_library_paths, write_launcher
from ludus.engine.routes import Progress, RouteUnavailable, UnpackedTemplate

__all__ = ["DebianTemplateRoute"]

_PROGRAM = "godot-template-release"


@dataclass(frozen=True)
class DebianTemplateRoute:
    """Unpacks the template's package, with all it depends on, into a private prefix."""

    name: str = "debian"

    def unpack_template(
        self, release: str, folder: Path, *, progress: Progress
    ) -> UnpackedTemplate:
        """Fetch and unpack the packages; see `TemplateRoute`. Debian has one release at a time."""
        if sys.platform != "linux":
            raise RouteUnavailable("this machine does not run Linux")
        prefix = unpack_packages([_PROGRAM, "patchelf"], folder, progress)
        # They name a folder of the system, where an exported game must not look.
        remove_library_paths(prefix, "libpulse*.so.*")
        program = find_program(prefix, _PROGRAM)
        launcher = folder / "template"
        write_launcher(launcher, prefix, program)
        return UnpackedTemplate(program, launcher, prefix)
