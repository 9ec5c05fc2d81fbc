"""The command for a program that starts it: it ends when it is told to, or left alone."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

pytestmark = pytest.mark.slow

CHILD = [sys.executable, "-P", "-m", "ludus.cli.child"]
TERMINATED = 143
DEADLINE_S = 60.0


def start_server(folder: Path) -> subprocess.Popen[bytes]:
    """Start a command that runs until it is stopped, and wait until it says that it runs."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [*CHILD, "serve", "--port", str(port), "--runs", str(folder / "runs")]
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    )
    assert process.stdout is not None
    assert str(port) in process.stdout.readline().decode()
    return process


def test_it_is_the_same_command() -> None:
    read, write = os.pipe()
    done = subprocess.run(
        [*CHILD, "nothing"], stdin=read, capture_output=True, text=True, check=False
    )
    for end in (read, write):
        os.close(end)
    assert done.returncode == 2
    assert "there is no command nothing" in done.stderr


@pytest.mark.parametrize("word", [b"stop\n", b""])
def test_it_stops_when_told_or_when_its_input_ends(tmp_path: Path, word: bytes) -> None:
    with start_server(tmp_path) as process:
        assert process.stdin is not None
        time.sleep(1.0)
        assert process.poll() is None
        process.stdin.write(word)
        process.stdin.close()
        assert process.wait(DEADLINE_S) == TERMINATED


ORPHAN = """\
import os, subprocess, sys, time
read, write = os.pipe()
child = subprocess.Popen(sys.argv[1:], stdin=read, pass_fds=[write])
print(child.pid, flush=True)
time.sleep(2.0)
"""


@pytest.mark.skipif(os.name != "posix", reason="elsewhere a process keeps its parent's number")
def test_it_stops_when_its_parent_has_gone(tmp_path: Path) -> None:
    """Something else holds its standard input open, as a game that the editor has started may."""
    command = [*CHILD, "serve", "--port", "0", "--runs", str(tmp_path / "runs")]
    parent = subprocess.Popen(
        [sys.executable, "-c", ORPHAN, *command], stdout=subprocess.PIPE, text=True
    )
    with parent:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        assert psutil.pid_exists(child)
        parent.wait(DEADLINE_S)
    deadline = time.monotonic() + DEADLINE_S
    while psutil.pid_exists(child) and time.monotonic() < deadline:
        if psutil.Process(child).status() == psutil.STATUS_ZOMBIE:
            break
        time.sleep(0.1)
    else:
        assert not psutil.pid_exists(child)
