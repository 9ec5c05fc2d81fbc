"""Sockets with deadlines."""

from ludus.link.acceptor import EngineAcceptor
from ludus.link.byte_stream import ByteStream, connect_until, refuse_stranger
from ludus.link.peer import is_strangers, listener_is_strangers
from ludus.link.pending_connection import PendingConnection, is_closed_by_peer
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
    "EngineAcceptor",
    "Link",
    "LinkClosed",
    "Listener",
    "PendingConnection",
    "connect",
    "connect_until",
    "is_closed_by_peer",
    "is_loopback",
    "is_strangers",
    "listen_tcp",
    "listener_is_strangers",
    "refuse_stranger",
]
