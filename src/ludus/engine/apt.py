"""Download Debian packages and unpack them into a folder, without root or a change to the system.

The packages come from Debian's unstable suite, through an apt configuration of our own that
knows one suite and no installed package.
"""

from __future__ import annotations

import logging
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from ludus.engine.installing import InstallerUnavailable, Progress
from ludus.engine.output import run_captured
from ludus.errors import SetupError

__all__ = ["SUITE", "unpack_packages"]

SUITE = "sid"
UPDATE_TIMEOUT_S = 180.0
DOWNLOAD_TIMEOUT_S = 900.0
UNPACK_TIMEOUT_S = 300.0

_KEYRINGS = (
    "/usr/share/keyrings/debian-archive-keyring.gpg",
    "/usr/share/keyrings/debian-archive-keyring.pgp",
)
# The machine's own apt settings still apply (proxies, for example), but not its hooks, which
# would change the system, and not its other sources.
_APT_CONF = """\
Dir::State "{tree}/state";
Dir::State::status "{tree}/status";
Dir::Cache "{tree}/cache";
Dir::Cache::archives "archives/";
Dir::Etc::sourcelist "{tree}/sources.list";
Dir::Etc::sourceparts "/dev/null";
Dir::Etc::preferences "/dev/null";
Dir::Etc::preferencesparts "/dev/null";
APT::Sandbox::User "";
Acquire::Retries "2";
Acquire::http::Timeout "15";
Acquire::https::Timeout "15";
#clear APT::Update::Pre-Invoke;
#clear APT::Update::Post-Invoke;
#clear APT::Update::Post-Invoke-Success;
#clear DPkg::Pre-Invoke;
#clear DPkg::Pre-Install-Pkgs;
#clear DPkg::Post-Invoke;
"""

_log = logging.getLogger(__name__)


def unpack_packages(packages: Sequence[str], folder: Path, progress: Progress) -> Path:
    """Fetch packages with all they depend on, and unpack them.

    Args:
        packages: Names of packages.
        folder: Gets the folder ``prefix`` with what was unpacked.
        progress: Called with what is being done.

    Returns:
        The prefix, whose programs need its own loader to start.

    Raises:
        InstallerUnavailable: This machine does not run Linux, has no apt, or cannot reach its
            Debian mirror.
        SetupError: A package cannot be unpacked, or the disk is full.
    """
    if sys.platform != "linux":
        raise InstallerUnavailable("this machine does not run Linux")
    for tool in ("apt-get", "dpkg-deb"):
        if shutil.which(tool) is None:
            raise InstallerUnavailable(f"this machine has no {tool}")
    tree, prefix = folder / "apt", folder / "prefix"
    prefix.mkdir()
    configuration = _make_apt_tree(tree)
    progress("read Debian's package list", None)
    _run_apt(configuration, ["update"], UPDATE_TIMEOUT_S)
    progress("download Debian packages", None)
    options = ["install", "--yes", "--download-only", "--no-install-recommends"]
    _run_apt(configuration, [*options, *packages], DOWNLOAD_TIMEOUT_S)
    _unpack_all(sorted((tree / "cache" / "archives").glob("*.deb")), prefix, progress)
    shutil.rmtree(tree)
    return prefix


def _make_apt_tree(tree: Path) -> Path:
    """Write a private apt configuration that knows one suite and no installed package."""
    keyring = next((name for name in _KEYRINGS if Path(name).is_file()), None)
    if keyring is None:
        raise InstallerUnavailable(
            "Debian's signing keys are not installed (package debian-archive-keyring)"
        )
    for part in ("state/lists/partial", "cache/archives/partial"):
        (tree / part).mkdir(parents=True)
    (tree / "status").touch()
    source = f"deb [signed-by={keyring} target=Packages] {_find_mirror()} {SUITE} main\n"
    (tree / "sources.list").write_text(source, encoding="utf-8")
    configuration = tree / "apt.conf"
    configuration.write_text(_APT_CONF.format(tree=tree), encoding="utf-8")
    return configuration


def _find_mirror() -> str:
    """Return the Debian mirror that this machine is configured to use."""
    form = "$(CREATED_BY)|$(LABEL)|$(SITE)"
    done = _run(["apt-get", "indextargets", "--format", form], UPDATE_TIMEOUT_S)
    rows = [line.split("|", 2) for line in done.stdout.splitlines() if line.count("|") >= 2]
    for created_by, label, site in rows:
        is_main = label == "Debian" or (label in {"", "$(LABEL)"} and "security" not in site)
        if created_by == "Packages" and is_main:
            return site
    raise InstallerUnavailable("the apt configuration of this machine names no Debian mirror")


def _run_apt(configuration: Path, arguments: Sequence[str], timeout_s: float) -> None:
    done = _run(["apt-get", "-q", "-c", str(configuration), *arguments], timeout_s)
    if done.returncode == 0:
        _log.debug("apt-get %s:\n%s", arguments[0], done.stdout)
        return
    lines = [line for line in done.stdout.splitlines() if line[:2] in {"E:", "W:"}][-6:]
    text = "\n  ".join([f"apt-get {arguments[0]} failed:", *lines])
    if "No space left" in done.stdout or "enough free space" in done.stdout:
        raise SetupError(text, hint="free about 1.5 GB on the disk of the user cache")
    raise InstallerUnavailable(text)


def _run(command: Sequence[str], timeout_s: float) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "LC_ALL": "C", "DEBIAN_FRONTEND": "noninteractive"}
    try:
        return run_captured(command, timeout_s, environment)
    except subprocess.TimeoutExpired as error:
        raise InstallerUnavailable(f"{command[0]} took more than {timeout_s:.0f} s") from error


def _unpack_all(archives: Sequence[Path], prefix: Path, progress: Progress) -> None:
    def unpack(archive: Path) -> None:
        done = _run(["dpkg-deb", "-x", str(archive), str(prefix)], UNPACK_TIMEOUT_S)
        if done.returncode != 0:
            raise SetupError(
                f"{archive.name} could not be unpacked: {done.stdout.strip()}",
                hint="free about 1.5 GB on the disk of the user cache, or try again",
            )
        archive.unlink()

    with ThreadPoolExecutor(max_workers=min(4, os.cpu_count() or 1)) as executor:
        for done, _ in enumerate(executor.map(unpack, archives), start=1):
            progress("unpack Debian packages", done / len(archives))
