"""The export template of the official release archives.

Godot packs the templates of all platforms into one archive of more than a gigabyte. Its SHA-512
is pinned here like those in `official`, and was taken from the same record.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ludus.engine.archive import unpack_zip
from ludus.engine.download import download
from ludus.engine.official import RELEASE_URL, Asset, platform_key
from ludus.engine.routes import Progress, RouteUnavailable, UnpackedTemplate
from ludus.errors import SetupError

__all__ = ["TEMPLATES", "OfficialTemplateRoute"]


def _templates(executable: str) -> Asset:
    return Asset(
        "4.6.3-stable",
        "Godot_v4.6.3-stable_export_templates.tpz",
        f"templates/{executable}",
        "da606b61c10157844f8300172df374472665f95015495cb1a7cd132c40ede404"
        "faa96cc1016a4b9662db9909ddea69632c4948b2cd11163438dad4808881fb68",
    )


TEMPLATES: dict[str, Asset] = {
    "linux-x86_64": _templates("linux_release.x86_64"),
    "linux-arm64": _templates("linux_release.arm64"),
}


@dataclass(frozen=True)
class OfficialTemplateRoute:
    """Downloads the templates from the project's own release page, and keeps the one for Linux.

    Attributes:
        base_url: Folder of the releases; tests point it at a local server.
        asset: The archive; None chooses the one for this machine.
    """

    base_url: str = RELEASE_URL
    asset: Asset | None = None
    name: str = "official"

    def unpack_template(
        self, release: str, folder: Path, *, progress: Progress
    ) -> UnpackedTemplate:
        """Download, check and unpack; see `TemplateRoute`."""
        asset = self._asset_for(release)
        archive = folder / asset.file_name
        download(f"{self.base_url}/{asset.tag}/{asset.file_name}", archive, asset.sha512, progress)
        progress(f"unpack {asset.file_name}", None)
        unpack_zip(archive, folder, only={asset.executable})
        archive.unlink()
        executable = folder / asset.executable
        if not executable.is_file():
            raise SetupError(f"{asset.file_name} has no {asset.executable}")
        executable.chmod(0o755)
        return UnpackedTemplate(executable, executable)

    def _asset_for(self, release: str) -> Asset:
        asset = self.asset or TEMPLATES.get(platform_key())
        if asset is None:
            raise RouteUnavailable(f"there is no template to run games on {platform_key()}")
        if asset.tag.replace("-", ".") != release:
            raise RouteUnavailable(f"Ludus knows the templates of {asset.tag}, not of {release}")
        return asset
