"""Good games pass, and the report says what was measured; real Godot."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from ludus.check import CHECKS, CheckConfig, CheckReport, Finding, Status, run_checks
from ludus.check.actions import check_actions
from ludus.check.determinism import check_determinism
from ludus.check.timing import check_timing
from ludus.check.vector_env import check_vector_env

pytestmark = [pytest.mark.engine, pytest.mark.games]

Checked = Callable[..., list[Finding]]


@pytest.fixture(scope="module")
def good_report(games: Path) -> CheckReport:
    return run_checks(
        CheckConfig(
            target=games / "good_grid.tscn",
            num_worlds=3,
            num_steps=60,
            num_layout_worlds=8,
            timing_s=0.05,
        )
    )


def test_good_game_has_neither_failures_nor_warnings(good_report: CheckReport) -> None:
    wrong = [f for _, f in good_report.findings if f.status in {Status.FAIL, Status.WARN}]
    assert wrong == []
    assert good_report.is_ok


def test_every_check_reports(good_report: CheckReport) -> None:
    assert {name for name, _ in good_report.findings} == set(CHECKS)


def test_layouts_are_equal_and_timed(good_report: CheckReport) -> None:
    verdict, speed = (f for name, f in good_report.findings if name == "layouts")
    assert verdict.data["verdict"] == "equal to the bit"
    assert speed.data["ratio"] > 0


def test_certificate_says_what_it_depends_on(good_report: CheckReport) -> None:
    certificate = good_report.to_json()["certificate"]
    assert certificate["engine"].startswith("godot 4")
    assert (certificate["num_worlds"], certificate["num_steps"]) == (3, 60)
    assert (certificate["layout"], certificate["seed"]) == ("grid", 0)
    assert certificate["ticks"] == 120


def test_certificate_is_the_same_another_time_and_changes_with_the_game(
    good_report: CheckReport, checked: Checked
) -> None:
    certificate = good_report.to_json()["certificate"]
    again = checked("good_grid", check_determinism)[0].data
    other = checked("same_start", check_determinism)[0].data
    assert again == certificate
    assert other["hash"] != certificate["hash"]
    assert other["spec"] == certificate["spec"]


def test_settling_worlds_keep_their_timing(checked: Checked) -> None:
    findings = checked("settling", check_timing)
    assert [f for f in findings if f.status is Status.FAIL] == []
    ticks = next(f for f in findings if "ticks" in f.title)
    assert ticks.data["settle_ticks"] == 3


def test_masks_are_honoured_everywhere(checked: Checked) -> None:
    findings = checked("masked", check_actions) + checked("masked", check_vector_env)
    assert [f for f in findings if f.status is not Status.OK] == []


def test_a_limit_that_no_episode_reaches_is_not_checked(checked: Checked) -> None:
    (limit,) = (f for f in checked("good", check_timing, 20) if "truncated after 40" in f.title)
    assert (limit.status, limit.detail) == (
        Status.INFO, "not checked: no episode lasted that long",
    )  # fmt: skip
