"""Install a product in the user cache: completely or not at all, and only once.

An `Installer` unpacks the product into a new folder that nothing takes for an installation. The
product is tried out there, and the folder renamed at the end. A lock lets only one process
install at a time; the others wait and use the result.
"""

from __future__ import annotations

import errno
import logging
import shutil
import tempfile
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, Protocol, TypeVar

from ludus.engine.cache import require_cache_root
from ludus.errors import SetupError
from ludus.locks import file_lock

__all__ = [
    "Installer",
    "InstallerUnavailable",
    "Product",
    "Progress",
    "Unpacked",
    "install",
    "no_progress",
]

LOCK_TIMEOUT_S = 1200.0

Progress = Callable[[str, float | None], None]
"""Called with what is being done and, where known, the fraction done in [0, 1]."""
ProductT = TypeVar("ProductT")

_INCOMING = ".incoming-"
_log = logging.getLogger(__name__)


def no_progress(_what: str, _fraction: float | None) -> None:
    """Report progress to nobody."""


class InstallerUnavailable(Exception):  # noqa: N818 - reads as what happened
    """This machine cannot use the installer (no network, no ``apt``…): try the next one."""


@dataclass(frozen=True)
class Unpacked:
    """Where an installer put a product.

    Attributes:
        program: What starts it here: a launcher, or the executable itself.
        executable: The executable itself.
        window_program: What opens a window; often the same as ``program``.
        has_rendering: Whether a window can be opened.
        prefix: The libraries that ``executable`` needs; None if those of the system do.
    """

    program: Path
    executable: Path
    window_program: Path
    has_rendering: bool = False
    prefix: Path | None = None


class Installer(Protocol):
    """A way to obtain one product."""

    @property
    def name(self) -> str:
        """Short name, part of the folder's name in the cache."""
        ...

    def unpack(self, folder: Path, progress: Progress) -> Unpacked:
        """Put the product into the empty ``folder``, which can be moved afterwards.

        Raises:
            InstallerUnavailable: The machine cannot use this installer, or it has another
                release.
            SetupError: The installer could be used, and failed.
        """
        ...


class Product(ABC, Generic[ProductT]):
    """Something that can be installed in the user cache.

    Attributes:
        label: Name for messages.
        folder: Where its installations lie, relative to the user cache.
        hint: What to do if no installer works here.
    """

    label: str
    folder: str
    hint: str

    @abstractmethod
    def find(self) -> ProductT | None:
        """Return what is installed already."""

    @abstractmethod
    def try_out(self, installer: str, folder: Path, unpacked: Unpacked) -> str:
        """Run what was unpacked, record what it is, and name its folder in the cache.

        Raises:
            InstallerUnavailable: It is of another release than needed.
            SetupError: It does not run, or is too old.
        """

    @abstractmethod
    def describe(self, folder: Path) -> ProductT:
        """Describe the installation in ``folder``."""


def install(
    product: Product[ProductT],
    installers: Sequence[Installer],
    *,
    force: bool = False,
    progress: Progress = no_progress,
) -> ProductT:
    """Install a product with the first installer that works, or return what is there already.

    Args:
        product: What to install.
        installers: Tried in this order.
        force: Install again even if it is there.
        progress: Called with what is being done.

    Raises:
        SetupError: No installer works here, one failed, another process holds the lock for too
            long, or the cache cannot be written; nothing is left behind.
    """
    folder = require_cache_root() / product.folder
    try:
        with file_lock(folder / ".install.lock", LOCK_TIMEOUT_S):
            for leftover in folder.glob(f"{_INCOMING}*"):
                shutil.rmtree(leftover, ignore_errors=True)
            present = None if force else product.find()
            return present or _install(product, installers, folder, progress)
    except OSError as error:
        is_full = error.errno in {errno.ENOSPC, errno.EDQUOT}
        hint = (
            f"free about 1.5 GB on the disk of {folder}" if is_full else f"make {folder} writable"
        )
        raise SetupError(f"{product.label} could not be installed: {error}", hint) from error


def _install(
    product: Product[ProductT], installers: Sequence[Installer], folder: Path, progress: Progress
) -> ProductT:
    refused: list[str] = []
    for installer in installers:
        incoming = Path(tempfile.mkdtemp(prefix=_INCOMING, dir=folder))
        try:
            unpacked = installer.unpack(incoming, progress)
            name = product.try_out(installer.name, incoming, unpacked)
            return product.describe(_move_in(incoming, folder / name))
        except InstallerUnavailable as reason:
            _log.info("installer %s: %s", installer.name, reason)
            refused.append(f"\n  {installer.name}: {reason}")
        finally:
            shutil.rmtree(incoming, ignore_errors=True)
    raise SetupError(f"{product.label} could not be installed:{''.join(refused)}", product.hint)


def _move_in(incoming: Path, target: Path) -> Path:
    """Rename ``incoming`` to ``target``, in place of what may be there."""
    if target.exists():
        # The next installation removes the old one if this process dies before it has done so.
        old = Path(tempfile.mkdtemp(prefix=_INCOMING, dir=target.parent))
        target.rename(old / "replaced")
        incoming.rename(target)
        shutil.rmtree(old, ignore_errors=True)
    else:
        incoming.rename(target)
    target.chmod(0o755)
    return target
