"""Workers as processes of this machine: ``python -m ludus.workers.process FD``.

Trainer and worker talk through a socket pair that nobody else can reach. The worker is a process of
its own, not a fork: a fork of a process that has used PyTorch may hang. It ends when the trainer
does, because reading from the pair then ends.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import logging
import signal
import socket
import subprocess
import sys
import threading
import time
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from ludus.errors import MachineLost
from ludus.settings.train_config import TrainConfig
from ludus.spec import Spec

__all__ = ["ProcessMachine"]

BEAT_S, SILENCE_S = 1.0, 30.0
"""Seconds between two signs of life of a worker that is busy; and without any until it is lost."""

END_S = 15.0
"""Seconds a worker has to end its games."""

PR_SET_PDEATHSIG = 1
"""Of Linux's ``prctl``: the signal that a process gets when the one that started it dies."""

log = logging.getLogger(__name__)


class ProcessMachine:
    """A worker process; a :class:`~ludus.workers.interface.Machine`.

    Args:
        config: Settings of the run.
        index: Number of the machine, from 0.
        log_dir: Where engines leave their output.
    """

    def __init__(self, config: TrainConfig, index: int, log_dir: Path | None) -> None:
        ours, theirs = socket.socketpair()
        self._connection = Connection(ours.detach())
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", __name__, str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                start_new_session=True,  # Ctrl-C is for the trainer, which ends its workers
            )
        self.name = f"machine {index} (process {self._process.pid})"
        self._is_closed = False
        self._send(sys.path, (config, index, log_dir))

    def send(self, method: str, *arguments: Any) -> None:
        """Call a method of the worker and return at once."""
        self._send(method, arguments)

    def receive(self) -> Any:
        """Return what the method that was called last returned, or raise what it raised."""
        while True:
            try:
                if not self._connection.poll(SILENCE_S):
                    self._process.kill()  # a process that is stopped dies of nothing else
                    self.close()
                    raise MachineLost(
                        f"{self.name} has given no sign of life for {SILENCE_S:.0f} s",
                        "it may be stopped, or its machine out of memory; --resume goes on from "
                        "the last checkpoint",
                    )
                kind, value = self._connection.recv()
            except (EOFError, OSError):
                raise self._lost() from None
            if kind == "log":
                name, level, text = value
                logging.getLogger(name).log(level, "%s: %s", self.name, text)
            elif kind == "error":
                raise value
            elif kind == "result":
                return value

    def _send(self, *message: Any) -> None:
        try:
            self._connection.send(message)
        except OSError:
            raise self._lost() from None

    def _lost(self) -> MachineLost:
        self.close()
        return MachineLost(
            f"{self.name} has died with exit code {self._process.returncode}",
            "--resume goes on from the last checkpoint",
        )

    def close(self) -> None:
        """End the worker and its games; may be called twice."""
        if self._is_closed:
            return
        self._is_closed = True
        self._connection.close()  # which the worker takes as its end
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(END_S)
        if self._process.poll() is None:
            log.warning("%s did not end and was killed", self.name)
            self._process.kill()
            self._process.wait()


class _Line(logging.Handler):
    """The worker's end: answers, signs of life, and what is logged."""

    def __init__(self, connection: Connection) -> None:
        super().__init__()
        self._connection = connection
        self._turn = threading.Lock()

    def tell(self, kind: str, value: Any = None) -> None:
        """Send a message."""
        with self._turn:
            self._connection.send((kind, value))

    def emit(self, record: logging.LogRecord) -> None:
        with contextlib.suppress(OSError):
            self.tell("log", (record.name, record.levelno, self.format(record)))

    def beat(self) -> None:
        """Give signs of life until the trainer is gone."""
        with contextlib.suppress(OSError):
            while True:
                self.tell("beat")
                time.sleep(BEAT_S)


def main(descriptor: int) -> None:
    """Be a worker until the trainer hangs up."""
    _go_on_without_parent()
    connection = Connection(descriptor)
    line = _Line(connection)
    threading.Thread(target=line.beat, daemon=True).start()
    with contextlib.suppress(EOFError, OSError):  # the trainer hung up
        sys.path[:], start = connection.recv()
        logging.getLogger("ludus").addHandler(line)
        logging.getLogger("ludus").propagate = False
        from ludus.workers.worker import Worker, outcome_of

        workers: list[Worker] = []

        def begin() -> Spec:
            workers.append(Worker(*start))
            return workers[0].spec

        try:
            line.tell(*outcome_of(begin))
            while workers:
                method, arguments = connection.recv()
                call = functools.partial(getattr(workers[0], method), *arguments)
                line.tell(*outcome_of(call))
        finally:
            for worker in workers:
                worker.close()


def _go_on_without_parent() -> None:
    """Have a worker that is stopped go on when its trainer dies, and so end (Linux only)."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, int(signal.SIGCONT))


if __name__ == "__main__":
    main(int(sys.argv[1]))
