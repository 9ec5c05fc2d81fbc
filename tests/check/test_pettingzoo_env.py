"""PettingZoo's tests as a check; real Godot."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import pytest

from ludus.check import CheckContext, Finding, Status
from ludus.check.pettingzoo_env import check_pettingzoo

pytestmark = [pytest.mark.engine, pytest.mark.games]

Checked = Callable[..., list[Finding]]


def results(findings: list[Finding]) -> dict[str, Status]:
    return {finding.title.removeprefix("pettingzoo.test."): finding.status for finding in findings}


@pytest.mark.libraries
def test_a_good_game_passes_and_a_game_with_own_chance_fails_by_its_seeds(checked: Checked) -> None:
    tests = ["parallel_api_test", "api_test", "seed_test"]
    assert results(checked("masked", check_pettingzoo)) == dict.fromkeys(tests, Status.OK)
    assert results(checked("masked_own_random", check_pettingzoo)) == {
        **dict.fromkeys(tests, Status.OK),
        "seed_test": Status.FAIL,
    }


def test_what_does_not_apply_or_is_not_installed_is_said(
    checked: Checked, monkeypatch: pytest.MonkeyPatch
) -> None:
    (finding,) = checked("good", check_pettingzoo)
    assert finding.status is Status.INFO
    assert "one agent" in finding.detail
    with monkeypatch.context() as patch:
        patch.setattr(CheckContext, "is_legacy", True)
        (finding,) = checked("masked", check_pettingzoo)
    assert finding.status is Status.INFO
    assert "options" in finding.detail
    missing: Any = None
    monkeypatch.setitem(sys.modules, "pettingzoo", missing)
    monkeypatch.delitem(sys.modules, "ludus.pettingzoo", raising=False)
    (finding,) = checked("masked", check_pettingzoo)
    assert finding.status is Status.INFO
    assert "pip install" in finding.hint
