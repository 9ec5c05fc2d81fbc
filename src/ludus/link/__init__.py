"""Sockets with deadlines."""

from ludus.link.sockets import Link, LinkClosed, Listener, connect

__all__ = ["Link", "LinkClosed", "Listener", "connect"]
