"""Does a game behave as an environment? Checks that run on any target, with the real engine."""

from ludus.check.context import CheckConfig, CheckContext
from ludus.check.finding import Finding, Status
from ludus.check.suite import CHECKS, CheckReport, run_checks

__all__ = [
    "CHECKS",
    "CheckConfig",
    "CheckContext",
    "CheckReport",
    "Finding",
    "Status",
    "run_checks",
]
