"""Whose program is at the other end of a connection of this machine, where the system tells."""

from __future__ import annotations

import os
import socket
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

__all__ = ["is_strangers", "listener_is_strangers"]

_TABLES = (Path("/proc/net/tcp"), Path("/proc/net/tcp6"))
_LISTENS = "0A"
_ROOT = 0
"""May read the memory of everybody, so that nothing is won by keeping it out."""


class _Row(NamedTuple):
    """A TCP socket of this machine; see proc_net_tcp(5) and tcp_states.h of Linux."""

    local: str
    remote: str
    state: str
    user: int
    inode: int


def is_strangers(connection: socket.socket) -> bool:
    """Return whether the other end of a TCP connection is another user's, on this machine.

    An end that is closed already counts as a stranger's. Return False for other machines, for
    sockets that only this user can reach, and where the system does not tell (it does on Linux).
    """
    if connection.family == getattr(socket, "AF_UNIX", None):
        return False
    try:
        ours, theirs = connection.getsockname()[:2], connection.getpeername()[:2]
    except OSError:  # it has gone
        return True
    if not theirs[0].startswith(("127.", "::1", "::ffff:127.")) or not _is_told():
        return False
    local, remote = _spellings(theirs), _spellings(ours)
    users = [
        row.user
        for row in _read_rows()
        # A socket without an inode is held by no program any more.
        if row.inode and row.local in local and row.remote in remote
    ]
    return not _are_ours(users)


def listener_is_strangers(port: int) -> bool:
    """Return whether another user listens at a TCP port of this machine, on any of its addresses.

    Return False where nobody listens, or the system does not tell.
    """
    suffix = f":{port:04X}"
    rows = _read_rows() if _is_told() else iter(())
    users = [row.user for row in rows if row.state == _LISTENS and row.local.endswith(suffix)]
    return bool(users) and not _are_ours(users)


def _is_told() -> bool:
    return any(os.access(table, os.R_OK) for table in _TABLES)


def _are_ours(users: list[int]) -> bool:
    return bool(users) and {*users} <= {os.geteuid(), _ROOT}


def _read_rows() -> Iterator[_Row]:
    for table in _TABLES:
        try:
            lines = table.read_text(encoding="ascii").splitlines()[1:]
        except OSError:  # a machine without IPv6 has no such table
            continue
        for line in lines:
            fields = line.split()
            yield _Row(fields[1], fields[2], fields[3], int(fields[7]), int(fields[9]))


def _spellings(address: tuple[str, int]) -> set[str]:
    """Return the ways in which the tables may write an address: engines use IPv6 for IPv4, too."""
    host, port = address
    host = host.removeprefix("::ffff:")
    numbers = [socket.inet_pton(socket.AF_INET6, host if ":" in host else f"::ffff:{host}")]
    if ":" not in host:
        numbers.append(socket.inet_aton(host))
    return {f"{_words(number)}:{port:04X}" for number in numbers}


def _words(number: bytes) -> str:
    words = struct.unpack(f"={len(number) // 4}I", number)
    return "".join(f"{word:08X}" for word in words)
