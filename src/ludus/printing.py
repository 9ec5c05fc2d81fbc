"""What may be shown on a terminal of texts that a game, a file or another program has written."""

from __future__ import annotations

import logging

__all__ = ["PrintableFormatter", "printable"]


def printable(text: str) -> str:
    """Return ``text`` with control characters escaped, as they can rewrite what a terminal shows.

    Line ends and tabs stay.
    """
    if text.isprintable():
        return text
    shown = (
        letter if letter.isprintable() or letter in "\n\t" else ascii(letter)[1:-1]
        for letter in text
    )
    return "".join(shown)


class PrintableFormatter(logging.Formatter):
    """Formats log records, control characters escaped."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the text of a record."""
        return printable(super().format(record))
