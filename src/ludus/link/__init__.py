"""Sockets with deadlines."""

from ludus.link.byte_stream import ByteStream, connect_until
from ludus.link.sockets import Link, LinkClosed, Listener, connect, listen_tcp

__all__ = [
    "ByteStream",
    "Link",
    "LinkClosed",
    "Listener",
    "connect",
    "connect_until",
    "listen_tcp",
]
