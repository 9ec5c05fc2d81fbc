"""All checks, in the order in which their findings are reported."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

from ludus.check.actions import check_actions
from ludus.check.causes import scene_changes
from ludus.check.context import CheckConfig, CheckContext, OneEngineOnly
from ludus.check.determinism import check_determinism
from ludus.check.finding import Finding, Status, fail, info, ok, warn
from ludus.check.frame_rules import check_frame_rules
from ludus.check.gymnasium_env import check_gymnasium
from ludus.check.layouts import check_layouts
from ludus.check.observations import check_observations
from ludus.check.pettingzoo_env import check_pettingzoo
from ludus.check.resets import check_resets
from ludus.check.seeds import check_seeds
from ludus.check.timing import check_timing
from ludus.check.vector_env import check_vector_env
from ludus.errors import LudusError

__all__ = ["CHECKS", "CheckReport", "run_checks"]

Check = Callable[[CheckContext], Iterable[Finding]]


def check_scripts(context: CheckContext) -> list[Finding]:
    """Pass on what the engine doubts about the game's scripts, and name changes of the scene."""
    doubts = list(context.spec.warnings)
    # The engine looks at nodes in the tree only, and in Godot 3 at none.
    doubts += [
        f"{place}: {text}"
        for place, text in scene_changes(context.scripts)
        if not any(f"{place}:" in doubt for doubt in doubts)
    ]
    title = "no mistake is seen in the game's scripts"
    return [warn("the game's scripts", text) for text in doubts] or [ok(title)]


CHECKS: dict[str, Check] = {
    "scripts": check_scripts,
    "timing": check_timing,
    "frames": check_frame_rules,
    "seeds": check_seeds,
    "determinism": check_determinism,
    "resets": check_resets,
    "gymnasium": check_gymnasium,
    "pettingzoo": check_pettingzoo,
    "vector": check_vector_env,
    "actions": check_actions,
    "observations": check_observations,
    "layouts": check_layouts,
}
"""Checks by name."""


@dataclass
class CheckReport:
    """The findings of all checks.

    Attributes:
        target: What was checked.
        scene: Its scene.
        engine: Name and version of the engine.
        findings: By check, in order.
    """

    target: str
    scene: str = ""
    engine: str = ""
    findings: list[tuple[str, Finding]] = field(default_factory=list[tuple[str, Finding]])

    @property
    def is_ok(self) -> bool:
        """Whether nothing failed."""
        return all(finding.status is not Status.FAIL for _, finding in self.findings)

    def count(self, status: Status) -> int:
        """Return how many findings have a status."""
        return sum(finding.status is status for _, finding in self.findings)

    def to_json(self) -> dict[str, Any]:
        """Return the report as JSON values."""
        certificates = [f.data for name, f in self.findings if name == "determinism"]
        return {
            "target": self.target,
            "scene": self.scene,
            "engine": self.engine,
            "ok": self.is_ok,
            "counts": {str(status): self.count(status) for status in Status},
            "certificate": next((data for data in certificates if "hash" in data), None),
            "findings": [{"check": name, **finding.to_json()} for name, finding in self.findings],
        }


def run_checks(
    config: CheckConfig, on_finding: Callable[[str, Finding], None] | None = None
) -> CheckReport:
    """Run every check on a target.

    If the game fails during a check, that is a finding, and the next check starts a new engine. If
    random play fails, that is the only finding.

    Args:
        config: What to check, and how thoroughly.
        on_finding: Called with the check's name and each finding as it is made.

    Raises:
        UsageError: The target or a setting is wrong.
        SetupError: There is no engine.
        EngineStartError: The game does not start.
    """
    report = CheckReport(str(config.target))

    def note(name: str, findings: Iterable[Finding]) -> None:
        for finding in findings:
            report.findings.append((name, finding))
            if on_finding is not None:
                on_finding(name, finding)

    with CheckContext(config) as context:
        with context.main_pool() as pool:
            report.scene = pool.spec.scene
        try:
            _ = context.recording
        except LudusError as error:
            note("play", [_game_failed("random play runs without an error", error)])
            return report
        report.engine = context.engine_version
        for name, check in CHECKS.items():
            try:
                note(name, check(context))
            except OneEngineOnly as error:
                note(name, [info("compared with a second process", error.message, error.hint)])
            except LudusError as error:
                note(name, [_game_failed("the check runs without an error", error)])
    return report


def _game_failed(title: str, error: LudusError) -> Finding:
    return fail(title, f"{type(error).__name__}: {error.message}", error.hint)
