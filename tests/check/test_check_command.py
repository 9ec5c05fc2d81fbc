"""``ludus check``: exit codes and output; real Godot."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from ludus.cli.main import main

pytestmark = [pytest.mark.engine, pytest.mark.games]


def test_failing_game_prints_one_json_object_and_exits_with_1(
    games: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = main(["check", str(games / "not_a_number.tscn"), "--json", "--steps", "40"])
    report = json.loads(capsys.readouterr().out)
    assert code == 1
    assert report["ok"] is False
    (finding,) = report["findings"]
    assert finding["check"] == "play"
    assert "nan" in finding["detail"]
    assert finding["hint"]


def test_failing_game_prints_a_line_with_a_hint(
    games: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = main(["check", str(games), "--scene", "not_a_number.tscn", "--steps", "40"])
    output = capsys.readouterr().out
    assert code == 1
    assert "FAIL play" in output
    assert "hint:" in output
    assert "1 fail" in output


def test_wrong_target_and_wrong_numbers_are_usage_errors(
    games: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", str(games / "nothing.tscn")]) == 2
    assert main(["check", str(games / "good.tscn"), "--steps", "0"]) == 2
    assert "num_steps must be at least 1, not 0" in capsys.readouterr().err
