"""Put something into a folder of the user cache: all of it or nothing, and once.

It is unpacked in a folder that nothing takes for an installation, tried out there, and renamed
at the end. A lock lets only one process install at a time; the others wait and use the result.
"""

from __future__ import annotations

import errno
import logging
import shutil
import tempfile
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol, TypeVar

from ludus.engine.routes import RouteUnavailable
from ludus.errors import SetupError
from ludus.locks import file_lock

__all__ = ["installing_into", "move_in", "unpack_by_first_route"]

LOCK_TIMEOUT_S = 1200.0

_INCOMING = ".incoming-"
_log = logging.getLogger(__name__)


class _Named(Protocol):
    @property
    def name(self) -> str: ...


RouteT = TypeVar("RouteT", bound=_Named)
ResultT = TypeVar("ResultT")


@contextmanager
def installing_into(folder: Path, what: str) -> Generator[None, None, None]:
    """Hold the lock of ``folder``, after removing what killed installations left there.

    Args:
        folder: Where installations of one kind lie.
        what: What is installed, for messages.

    Raises:
        SetupError: Another process holds the lock for too long, the disk is full, or the
            folder cannot be written.
    """
    try:
        with file_lock(folder / ".install.lock", LOCK_TIMEOUT_S):
            for leftover in folder.glob(f"{_INCOMING}*"):
                shutil.rmtree(leftover, ignore_errors=True)
            yield
    except OSError as error:
        raise _disk_error(error, folder, what) from error


def unpack_by_first_route(
    routes: Sequence[RouteT],
    folder: Path,
    unpack: Callable[[RouteT, Path], ResultT],
    failure: SetupError,
) -> ResultT:
    """Let the first route that works here fill a new folder, which ``unpack`` then moves in.

    Args:
        routes: Ways to try, in this order.
        folder: Where the new folder is made; the caller holds its lock.
        unpack: Gets the route and the new, empty folder.
        failure: Raised, with the reasons of all routes added, if none works.

    Raises:
        SetupError: No route works here, or one failed; nothing is left behind.
    """
    refused: list[str] = []
    for route in routes:
        incoming = Path(tempfile.mkdtemp(prefix=_INCOMING, dir=folder))
        try:
            return unpack(route, incoming)
        except RouteUnavailable as reason:
            _log.info("route %s: %s", route.name, reason)
            refused.append(f"  {route.name}: {reason}")
        finally:
            shutil.rmtree(incoming, ignore_errors=True)
    raise SetupError("\n".join([f"{failure.message}:", *refused]), failure.hint)


def move_in(incoming: Path, target: Path) -> Path:
    """Rename ``incoming`` to ``target``, in place of what may be there; return ``target``."""
    if target.exists():
        old = Path(tempfile.mkdtemp(prefix=_INCOMING, dir=target.parent))
        target.rename(old / "replaced")
        incoming.rename(target)
        shutil.rmtree(old, ignore_errors=True)
    else:
        incoming.rename(target)
    target.chmod(0o755)
    return target


def _disk_error(error: OSError, folder: Path, what: str) -> SetupError:
    if error.errno in {errno.ENOSPC, errno.EDQUOT}:
        hint = f"free about 1.5 GB on the disk of {folder}"
    else:
        hint = f"make sure that {folder} can be written"
    return SetupError(f"{what} could not be installed: {error}", hint=hint)
