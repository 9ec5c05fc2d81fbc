"""The ``ludus`` command."""

from ludus.cli.main import main

__all__ = ["main"]
