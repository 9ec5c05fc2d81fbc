"""The findings of a check."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from enum import StrEnum
from typing import Any

__all__ = ["Finding", "Status"]


class Status(StrEnum):
    """Severity of a finding; only ``FAIL`` makes the whole check fail."""

    OK = "ok"
    INFO = "info"
    WARN = "warn"
    FAIL = "fail"


@dataclass(frozen=True)
class Finding:
    """One result of a check.

    Attributes:
        status: Its severity.
        title: What was checked, in a few words.
        detail: What was seen, and what was expected.
        hint: What the reader can do about it; empty if there is nothing to do.
        data: Figures, as JSON values.
    """

    status: Status
    title: str
    detail: str = ""
    hint: str = ""
    data: dict[str, Any] = field(default_factory=dict[str, Any])

    def to_json(self) -> dict[str, Any]:
        """Return the finding as JSON values."""
        return asdict(self)


def ok(title: str, detail: str = "", **data: Any) -> Finding:
    """Return a finding that a rule is kept."""
    return Finding(Status.OK, title, detail, data=data)


def info(title: str, detail: str = "", hint: str = "", **data: Any) -> Finding:
    """Return a finding worth knowing, or that a check does not apply."""
    return Finding(Status.INFO, title, detail, hint, data)


def warn(title: str, detail: str, hint: str = "", **data: Any) -> Finding:
    """Return a finding of what will probably hurt learning."""
    return Finding(Status.WARN, title, detail, hint, data)


def fail(title: str, detail: str, hint: str = "", **data: Any) -> Finding:
    """Return a finding that a rule is broken."""
    return Finding(Status.FAIL, title, detail, hint, data)
