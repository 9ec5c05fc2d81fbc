"""``python -m ludus.cli.child COMMAND …``: the ``ludus`` command for a program that starts it.

The dock in Godot's editor uses it. The command ends as by SIGTERM, which saves what was learnt,
when it reads ``stop``, when its standard input ends, or when its parent has ended.
Lines are written as they come.
"""

from __future__ import annotations

import contextlib
import io
import os
import select
import signal
import sys
import threading
import time
from typing import NoReturn

from ludus.cli.main import main

__all__ = ["run_as_child"]

POLL_S = 0.5
PATIENCE_S = 30.0
"""How long it may take to end; then it is ended at once."""
EXIT_FORCED = 1


def run_as_child() -> NoReturn:
    """Run the command of the process's arguments and exit."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(line_buffering=True)
    is_over = threading.Event()
    threading.Thread(target=_end_when_told, args=(os.getppid(), is_over), daemon=True).start()
    exit_code = main()
    is_over.set()
    sys.exit(exit_code)


def _end_when_told(parent: int, is_over: threading.Event) -> None:
    _await_word(parent)
    if is_over.is_set():
        return
    main_thread = threading.main_thread().ident
    if hasattr(signal, "pthread_kill") and main_thread is not None:
        signal.pthread_kill(main_thread, signal.SIGTERM)  # wakes it where it waits
    else:
        signal.raise_signal(signal.SIGTERM)
    time.sleep(PATIENCE_S)
    os._exit(EXIT_FORCED)


def _await_word(parent: int) -> None:
    """Return when standard input says so or ends, or the parent has ended."""
    source = 0
    with contextlib.suppress(OSError):
        while os.getppid() == parent:
            # Windows can select sockets only, and knows no new parent.
            if os.name == "posix" and not select.select([source], [], [], POLL_S)[0]:
                continue
            words = os.read(source, 64)
            if not words or b"stop" in words:
                return


if __name__ == "__main__":
    run_as_child()
