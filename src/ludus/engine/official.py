"""Install the official release archives of Godot.

The SHA-512 of every archive is pinned here. The sums were taken from the release records in
https://github.com/godotengine/godot-builds (``releases/godot-<version>-stable.json``), which
list the same sums as the ``SHA512-SUMS.txt`` beside each release.
"""

from __future__ import annotations

import platform
import sys
from dataclasses import dataclass
from pathlib import Path

from ludus.engine.archive import unpack_zip
from ludus.engine.download import download
from ludus.engine.installing import InstallerUnavailable, Progress, Unpacked
from ludus.engine.kinds import EngineKind
from ludus.errors import SetupError

__all__ = [
    "ENGINES",
    "TEMPLATES",
    "Archive",
    "OfficialInstaller",
    "official_engine",
    "official_template",
    "platform_key",
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


def _godot4(suffix: str, sha512: str, executable: str | None = None) -> Archive:
    name = f"Godot_v4.6.3-stable_{suffix}"
    return Archive("4.6.3-stable", f"{name}.zip", executable or name, sha512)


def _godot3(suffix: str, sha512: str, executable: str | None = None) -> Archive:
    name = f"Godot_v3.6.2-stable_{suffix}"
    is_server = "headless" in suffix
    return Archive("3.6.2-stable", f"{name}.zip", executable or name, sha512, not is_server)


# The first archive that an entry lists runs without a window; the others are fetched for
# rendering only.
ENGINES: dict[tuple[EngineKind, str], tuple[Archive, ...]] = {
    (EngineKind.GODOT4, "linux-x86_64"): (
        _godot4(
            "linux.x86_64",
            "a035258da32b77f966a5376f9fa29c30a6adde826a85ba918e1605bd1fc9823e"
            "ba7d85f1dd5e748956bd2ba72827c0025ffa11bb82aec91128c407a2e723c99c",
        ),
    ),
    (EngineKind.GODOT4, "linux-arm64"): (
        _godot4(
            "linux.arm64",
            "447381de9ccc68aa02f37e279322289f7ddf88ce9b839ed88a97c73e01cdcda4"
            "6e026897e5d88722e08491f71b3d74f72dfeb22ec7e3add6fd3e9bfbbdad6751",
        ),
    ),
    (EngineKind.GODOT4, "macos"): (
        _godot4(
            "macos.universal",
            "0155bbc8dcf179edab4ef08e3dbbd4480d7434ab1990cb3fb25517d453b1b657"
            "87c7fe6dfc8824b15ff25e1fdcec59e8584f765054106894fee00311868c3964",
            executable="Godot.app/Contents/MacOS/Godot",
        ),
    ),
    (EngineKind.GODOT4, "windows-x86_64"): (
        _godot4(
            "win64.exe",
            "d44ea7ef5bab754cacd49d581b6062836b2eea12a82e1d183aebfad9cd8c7db2"
            "bd82513337bd657d6d2d5c04d46239c0570b029faf1343e81e8a2fa7b85dd83b",
        ),
    ),
    (EngineKind.GODOT4, "windows-arm64"): (
        _godot4(
            "windows_arm64.exe",
            "927f182b0a722e6fa80f70262c89862adedcd539c9700a5526749a30a6bcec0b"
            "979d0d9faa0fed9d8b4362dc8b4ee0e3b0ddc708995906705ea004062bc7d294",
        ),
    ),
    (EngineKind.GODOT3, "linux-x86_64"): (
        _godot3(
            "linux_headless.64",
            "674dd18e89d4eaac62d83346776133abf987b6e85dad9b6842bd5f574d954c6f"
            "2774e9f527d4b763ba9f4765ee0c427b58dcadf96cd8da09ac8fae0ec08f3693",
        ),
        _godot3(
            "x11.64",
            "b131d94494ecc2c61ba1b266b17fc1f40e0707c5d38ce88fe017b67298caf7cb"
            "0cc87210dcd44c5c36b17fad45b8587285d4d9c74d985179b1b1041ea00d4022",
        ),
    ),
    (EngineKind.GODOT3, "macos"): (
        _godot3(
            "osx.universal",
            "a3b19054ee5d8ed84ca4fdb00c33ee4c5797381d57f8408cdb6f4d62195d3c2e"
            "0297dfd88e7262778e06efef28503db60de33c70c521e343a3b08d35ae1c54b3",
            executable="Godot.app/Contents/MacOS/Godot",
        ),
    ),
    (EngineKind.GODOT3, "windows-x86_64"): (
        _godot3(
            "win64.exe",
            "8e4d7732362b10a6e444e5c9ab6eddb0b25ab8f18f3c99b9289e2ae27891c208"
            "e933643410e0c237e01e0940b12cf1222bc6c3a4434757c12c3982d6c3d5d9ee",
        ),
    ),
}


def _templates(executable: str) -> tuple[Archive]:
    return (
        Archive(
            "4.6.3-stable",
            "Godot_v4.6.3-stable_export_templates.tpz",
            f"templates/{executable}",
            "da606b61c10157844f8300172df374472665f95015495cb1a7cd132c40ede404"
            "faa96cc1016a4b9662db9909ddea69632c4948b2cd11163438dad4808881fb68",
            is_whole=False,
        ),
    )


# One archive, of more than a gigabyte, contains the templates of all platforms.
TEMPLATES: dict[str, tuple[Archive, ...]] = {
    "linux-x86_64": _templates("linux_release.x86_64"),
    "linux-arm64": _templates("linux_release.arm64"),
}


def platform_key() -> str:
    """Name this machine the way the table of archives does, such as ``linux-x86_64``."""
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
    archives = ENGINES.get((kind, platform_key()), ())
    return OfficialInstaller(archives if rendering else archives[:1])


def official_template(release: str) -> OfficialInstaller:
    """Return the installer of the export template for this machine."""
    return OfficialInstaller(TEMPLATES.get(platform_key(), ()), release)
