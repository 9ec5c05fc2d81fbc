"""Packages that only some features need, and what brings them."""

from __future__ import annotations

import importlib
import importlib.metadata
import json
import re
import shlex
from urllib.parse import unquote

from ludus.errors import MissingExtra

__all__ = ["EXTRAS", "install_hint", "missing_extra", "require_package"]

DISTRIBUTION = "ludus-rl"

EXTRAS = {"platformdirs": "engine", "tyro": "cli", "rich": "cli", "psutil": "cli",
          "torch": "train", "safetensors": "train", "tensorboard": "train",
          "matplotlib": "train", "onnx": "export", "onnxruntime": "export",
          "av": "record", "ray": "cluster"}  # fmt: skip
"""Which extra brings a package that may be missing."""


def install_hint(extra: str) -> str:
    """Return the command that installs what an extra of this package names.

    Ludus is not on PyPI: pip is told where this copy came from, or else the packages themselves.
    """
    try:
        distribution = importlib.metadata.distribution(DISTRIBUTION)
    except importlib.metadata.PackageNotFoundError:
        return f"install Ludus with its extra [{extra}]"
    # https://packaging.python.org/en/latest/specifications/direct-url-data-structure/
    origin = json.loads(distribution.read_text("direct_url.json") or "{}")
    source = origin.get("url", "")
    if commit := origin.get("vcs_info"):
        url = f"{commit['vcs']}+{source}@{commit['commit_id']}"
        needed = [f"{DISTRIBUTION}[{extra}] @ {url}"]
    elif source.startswith("file://"):
        needed = [f"{unquote(source.removeprefix('file://'))}[{extra}]"]
    elif source:
        needed = [f"{DISTRIBUTION}[{extra}] @ {source}"]
    else:
        needed = sorted(_requirements(distribution, extra))
    return f"pip install {shlex.join(needed)}"


def missing_extra(package: str, extra: str = "") -> MissingExtra:
    """Return the error for a package that is not installed.

    Args:
        package: Its name.
        extra: What brings it; by default as :data:`EXTRAS` says.
    """
    hint = install_hint(extra or EXTRAS[package])
    return MissingExtra(f"{package} is not installed", hint)


def require_package(package: str) -> None:
    """Import a package, whose extra is named if it is missing.

    Raises:
        MissingExtra: It is not installed.
    """
    try:
        importlib.import_module(package)
    except ModuleNotFoundError as error:
        if error.name != package:
            raise  # it is there, and lacks something itself
        raise missing_extra(package) from error


def _requirements(distribution: importlib.metadata.Distribution, extra: str) -> set[str]:
    """Return the packages of an extra, and of the extras that it names."""
    found: set[str] = set()
    for line in distribution.requires or ():
        needed, _, marker = line.partition(";")
        if not re.search(rf"extra\s*==\s*['\"]{re.escape(extra)}['\"]", marker):
            continue
        own = re.match(rf"{DISTRIBUTION}\[(.+)\]", needed.strip())
        if own is None:
            found.add(needed.strip())
        else:
            for name in own[1].split(","):
                found |= _requirements(distribution, name.strip())
    return found
