"""What a check found."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

__all__ = ["Finding", "Status"]


class Status(StrEnum):
    """How good a finding is; only ``FAIL`` makes the whole check fail."""

    OK = "ok"
    INFO = "info"
    WARN = "warn"
    FAIL = "fail"


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at.

    Attributes:
        status: How good it is.
        title: What was looked at, in a few words.
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
        return {
            "status": str(self.status),
            "title": self.title,
            "detail": self.detail,
            "hint": self.hint,
            "data": self.data,
        }


def ok(title: str, detail: str = "", **data: Any) -> Finding:
    """Say that something is as it should be."""
    return Finding(Status.OK, title, detail, data=data)


def info(title: str, detail: str = "", hint: str = "", **data: Any) -> Finding:
    """Say something worth knowing."""
    return Finding(Status.INFO, title, detail, hint, data)


def warn(title: str, detail: str, hint: str = "", **data: Any) -> Finding:
    """Say that something will probably hurt learning."""
    return Finding(Status.WARN, title, detail, hint, data)


def fail(title: str, detail: str, hint: str = "", **data: Any) -> Finding:
    """Say that a rule was broken."""
    return Finding(Status.FAIL, title, detail, hint, data)
