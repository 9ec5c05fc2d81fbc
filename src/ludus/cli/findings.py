"""Print the findings of checks."""

from __future__ import annotations

from rich.console import Console
from rich.markup import escape
from rich.padding import Padding

from ludus.check import CheckReport, Finding, Status

__all__ = ["FindingPrinter"]

WORDS = {
    Status.OK: "[green]ok  [/]",
    Status.INFO: "[blue]info[/]",
    Status.WARN: "[yellow]warn[/]",
    Status.FAIL: "[bold red]FAIL[/]",
}
INDENT = 19


class FindingPrinter:
    """Prints findings as they come."""

    def __init__(self, console: Console) -> None:
        self._console = console

    def show(self, check: str, finding: Finding) -> None:
        """Print one finding: a line, with detail and hint below it."""
        head = f"{WORDS[finding.status]} {check:<13} {escape(finding.title)}"
        is_brief = finding.status is Status.OK
        if is_brief and finding.detail:
            head += f" [dim]({escape(finding.detail)})[/]"
        self._console.print(head, highlight=False, soft_wrap=True)
        if finding.detail and not is_brief:
            self._below(escape(finding.detail))
        if finding.hint:
            self._below(f"[cyan]hint:[/] {escape(finding.hint)}")

    def summarise(self, report: CheckReport) -> None:
        """Print the verdict and the number of findings of each status."""
        counts = ", ".join(f"{report.count(status)} {status}" for status in Status)
        verdict = "[green]passed[/]" if report.is_ok else "[bold red]FAILED[/]"
        self._console.print(
            f"{escape(report.target)}: {verdict} ({counts})", highlight=False, soft_wrap=True
        )

    def _below(self, text: str) -> None:
        if self._console.is_terminal:
            self._console.print(Padding(text, (0, 0, 0, INDENT)), highlight=False)
        else:
            self._console.print(" " * INDENT + text, highlight=False, soft_wrap=True)
