"""Sockets with deadlines."""

from ludus.link.byte_stream import ByteStream, connect_until, refuse_stranger
from ludus.link.door import Door
from ludus.link.guest import Guest, is_closed_by_peer
from ludus.link.peer import is_strangers, listener_is_strangers
from ludus.link.sockets import (
    BACKLOG,
    Link,
    LinkClosed,
    Listener,
    connect,
    is_loopback,
    listen_tcp,
)

__all__ = [
    "BACKLOG",
    "ByteStream",
    "Door",
    "Guest",
    "Link",
    "LinkClosed",
    "Listener",
    "connect",
    "connect_until",
    "is_closed_by_peer",
    "is_loopback",
    "is_strangers",
    "listen_tcp",
    "listener_is_strangers",
    "refuse_stranger",
]
