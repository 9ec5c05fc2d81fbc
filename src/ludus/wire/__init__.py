"""Frames and the connection's state machine, without any input or output (PROTOCOL.md)."""
