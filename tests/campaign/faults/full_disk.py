"""A disk that is full: a small file system where we may make one, else a limit of file sizes."""

from __future__ import annotations

import contextlib
import functools
import resource
import signal
import subprocess
import tempfile
from collections.abc import Callable, Generator
from pathlib import Path

from tests.campaign.promises import check_all, check_ending
from tests.campaign.rounds import Finding, Round

__all__ = ["can_mount", "fill_disk"]


def fill_disk(the_round: Round) -> None:
    """Train where there is room for some checkpoints only; then there is more room."""
    chance = the_round.chance
    kib = chance.choice([chance.randint(0, 64), chance.randint(16, 600)])
    is_limit = chance.random() < 0.3 or not can_mount()
    the_round.counts["full disks"] += 1
    if is_limit:
        the_round.decide(f"no file may be larger than {kib} KiB")
        check_full(the_round, lambda: _limit_files(kib << 10))
        check_all(the_round)
        return
    the_round.decide(f"a file system of {kib} KiB")
    with _small_disk(the_round.run.parent, max(kib, 4)):
        check_full(the_round, None)
        _mount("-o", "remount,size=64m", str(the_round.run.parent))
        check_all(the_round)


def check_full(the_round: Round, before: Callable[[], None] | None) -> None:
    """Train; it ends, or says what it could not write."""
    trainer = the_round.begin(before=before)
    check_ending(trainer, 0, 5)
    if trainer.wait() and "cannot write" not in trainer.text():
        raise Finding(f"a full disk is not what it says:\n{trainer.text()}")


def _limit_files(num_bytes: int) -> None:
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (num_bytes, num_bytes))


@functools.cache
def can_mount() -> bool:
    """Whether this user may mount file systems."""
    with tempfile.TemporaryDirectory() as folder:
        if _mount("-t", "tmpfs", "-o", "size=4k", "tmpfs", folder):
            return subprocess.run(["umount", folder], check=False).returncode == 0
    return False


@contextlib.contextmanager
def _small_disk(folder: Path, kib: int) -> Generator[None, None, None]:
    folder.mkdir()
    if not _mount("-t", "tmpfs", "-o", f"size={kib}k", "tmpfs", str(folder)):
        raise OSError(f"cannot mount a file system at {folder}")
    try:
        yield
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)


def _mount(*arguments: str) -> bool:
    try:
        done = subprocess.run(["mount", *arguments], capture_output=True, check=False)
    except OSError:
        return False
    return done.returncode == 0
