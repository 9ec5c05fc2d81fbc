"""Install the official release archives of Godot; ``releases.toml`` pins their checksums."""

from __future__ import annotations

import platform
import sys
import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal

from ludus.engine.archive import unpack_zip
from ludus.engine.download import download
from ludus.engine.installing import InstallerUnavailable, Progress, Unpacked
from ludus.engine.kinds import EngineKind
from ludus.errors import SetupError

__all__ = [
    "Archive",
    "OfficialInstaller",
    "official_engine",
    "official_template",
    "platform_key",
    "read_releases",
]

RELEASE_URL = "https://github.com/godotengine/godot/releases/download"


@dataclass(frozen=True)
class Archive:
    """One archive of a release.

    Attributes:
        tag: Tag of the release.
        file_name: Name of the archive.
        executable: Path of the executable inside.
        sha512: Checksum of the archive, lower-case hexadecimal.
        has_windows: Whether the executable can open a window.
        is_whole: Whether the whole archive is needed, or only the executable.
    """

    tag: str
    file_name: str
    executable: str
    sha512: str
    has_windows: bool = True
    is_whole: bool = True


Releases = dict[tuple[EngineKind, str], tuple[Archive, ...]]
"""Archives by engine and platform."""


@cache
def read_releases(product: Literal["engine", "template"]) -> Releases:
    """Return the archives of engines, or of export templates, that ``releases.toml`` lists."""
    text = Path(__file__).with_name("releases.toml").read_text(encoding="utf-8")
    releases: Releases = {}
    for row in tomllib.loads(text)[product]:
        key = EngineKind(row.pop("kind")), row.pop("platform")
        releases[key] = (*releases.get(key, ()), Archive(**row))
    return releases


def platform_key() -> str:
    """Name this machine as ``releases.toml`` does, such as ``linux-x86_64``."""
    system = {"darwin": "macos", "win32": "windows"}.get(sys.platform, sys.platform)
    if system == "macos":
        return system
    machine = platform.machine().lower()
    names = {"amd64": "x86_64", "aarch64": "arm64"}
    return f"{system}-{names.get(machine, machine)}"


@dataclass(frozen=True)
class OfficialInstaller:
    """Downloads release archives from the project's own release page.

    Attributes:
        archives: The first one contains what runs without a window, the last one what opens
            windows; empty if there is none for this platform.
        release: Release that is needed, such as ``4.6.3.stable``; empty if any will do.
        base_url: Folder of the releases; tests point it at a local server.
    """

    archives: tuple[Archive, ...]
    release: str = ""
    base_url: str = RELEASE_URL
    name: str = "official"

    def unpack(self, folder: Path, progress: Progress) -> Unpacked:
        """Download, check and unpack; see `Installer`."""
        if not self.archives:
            raise InstallerUnavailable(f"there is no official archive for {platform_key()}")
        last = self.archives[-1]
        if self.release not in {"", last.tag.replace("-", ".")}:
            raise InstallerUnavailable(f"it has {last.tag}, expected {self.release}")
        programs = [self._fetch(archive, folder, progress) for archive in self.archives]
        return Unpacked(programs[0], programs[0], programs[-1], last.has_windows)

    def _fetch(self, archive: Archive, folder: Path, progress: Progress) -> Path:
        file = folder / archive.file_name
        url = f"{self.base_url}/{archive.tag}/{archive.file_name}"
        download(url, file, archive.sha512, progress)
        progress(f"unpack {archive.file_name}", None)
        unpack_zip(file, folder, None if archive.is_whole else {archive.executable})
        file.unlink()
        executable = folder / archive.executable
        if not executable.is_file():
            raise SetupError(f"{archive.file_name} does not contain {archive.executable}")
        executable.chmod(0o755)
        return executable


def official_engine(kind: EngineKind, rendering: bool) -> OfficialInstaller:
    """Return the installer of an engine for this machine."""
    archives = read_releases("engine").get((kind, platform_key()), ())
    return OfficialInstaller(archives if rendering else archives[:1])


def official_template(release: str) -> OfficialInstaller:
    """Return the installer of the export template for this machine."""
    archives = read_releases("template").get((EngineKind.GODOT4, platform_key()), ())
    return OfficialInstaller(archives, release)
