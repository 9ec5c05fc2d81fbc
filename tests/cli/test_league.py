"""``ludus league`` on runs trained in real Godot."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest

from ludus.cli.main import main
from tests.cli.short_runs import short_run
from tests.league.duel import make_project

TAG = [
    "tag", "--num-worlds", "8", "--num-engines", "1", "--total-steps", "8192", "--seed", "3",
    "--ppo.hidden-sizes", "16", "--max-episode-steps", "40", "--evaluation-episodes", "0",
    "--league.share", "0.5", "--league.snapshot-every-updates", "4", "--name", "tag",
]  # fmt: skip
DUEL = [
    "--num-worlds", "4", "--num-engines", "1", "--total-steps", "2048", "--seed", "3",
    "--evaluation-episodes", "0", "--checkpoint-every-updates", "2", "--checkpoint-every-s", "None",
    "--ppo.hidden-sizes", "8", "--name", "duel",
]  # fmt: skip


@pytest.fixture(scope="module")
def tag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    runs = tmp_path_factory.mktemp("runs")
    assert main(["train", *TAG, "--runs", str(runs)]) == 0
    return runs / "tag"


@pytest.fixture(scope="module")
def duel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run without self-play, in a folder with the project it was trained in."""
    folder = tmp_path_factory.mktemp("games")
    project = make_project(folder / "project")
    assert main(["train", str(project), *DUEL, "--runs", str(folder)]) == 0
    return folder / "duel"


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of one agent."""
    return short_run(tmp_path_factory.mktemp("alone"))


@pytest.mark.engine
def test_past_selves_and_newest_policies_play(
    tag: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["league", str(tag), "--episodes", "5", "--json"]) == 0
    (table,) = json.loads(capsys.readouterr().out)["tables"]
    assert {player["policy"] for player in table["rows"]} == {"chaser"}
    assert {player["policy"] for player in table["columns"]} == {"runner"}
    assert [player["is_newest"] for player in table["rows"]][-2:] == [False, True]
    updates = [player["updates"] for player in table["rows"]]
    assert updates == sorted(set(updates))
    assert [number % 4 for number in updates[:-1]] == [0] * (len(updates) - 1)
    assert all(player["elo"] is not None for player in table["rows"] + table["columns"])
    for row in zip(table["wins"], table["draws"], table["losses"], strict=True):
        assert [sum(cell) for cell in zip(*row, strict=True)] == [5] * len(table["columns"])


@pytest.mark.engine
def test_the_table(tag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    typed = ["league", str(tag), "--episodes", "2", "--max-players", "2", "--deterministic"]
    assert main(typed) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("chaser (rows) against runner (columns)")
    (heading,) = [line.split() for line in lines if line.strip().startswith("updates")]
    assert heading[2:] == ["now", "all", "elo"]
    (now,) = [line.split() for line in lines if line.strip().startswith("now")]
    assert all(0 <= int(cell) <= 100 for cell in now[1:4])
    assert any(re.match(r" +elo +\d+ +\d+", line) for line in lines)


@pytest.mark.engine
def test_equal_seeds_give_equal_tables(tag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found: list[Any] = []
    for seed in ("1", "1", "2"):
        typed = ["--episodes", "10", "--max-players", "2", "--seed", seed, "--json"]
        assert main(["league", str(tag), *typed]) == 0
        found.append(json.loads(capsys.readouterr().out)["tables"])
    assert found[0] == found[1]
    assert found[0] != found[2]


@pytest.mark.engine
def test_ratings_from_training(tag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["league", str(tag), "--recorded", "--json"]) == 0
    policies = json.loads(capsys.readouterr().out)["policies"]
    last = (tag / "metrics.jsonl").read_text().splitlines()[-1]
    for name, values in json.loads(last)["policies"].items():
        assert policies[name][-1]["elo"] == values["elo"]
    assert main(["league", str(tag), "--recorded"]) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["chaser", "now", f"{policies['chaser'][-1]['elo']:.0f}"] in rows


@pytest.mark.engine
def test_without_self_play_checkpoints_play(duel: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["league", str(duel), "--episodes", "4", "--json"]) == 0
    (table,) = json.loads(capsys.readouterr().out)["tables"]
    assert len(table["rows"]) == len(list((duel / "checkpoints").glob("step-*")))
    assert table["rows"][0]["elo"] is None
    assert main(["league", str(duel), "--episodes", "1"]) == 0
    assert "elo" not in capsys.readouterr().out
    assert main(["league", str(duel), "--recorded"]) == 2
    assert "was trained without self-play" in capsys.readouterr().err


@pytest.mark.engine
def test_a_game_that_is_gone_is_said_plainly(
    duel: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    moved = Path(shutil.copytree(duel, tmp_path / "duel"))
    settings = json.loads((moved / "config.json").read_bytes())
    settings["target"] = str(tmp_path / "gone")
    (moved / "config.json").write_text(json.dumps(settings))
    assert main(["league", str(moved)]) == 2
    captured = capsys.readouterr()
    assert str(tmp_path / "gone") in captured.err
    assert captured.out == ""


@pytest.mark.engine
def test_another_game_is_refused(tag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["league", str(tag), "--target", "cartpole", "--num-worlds", "1"]) == 5
    assert "has no policy cart" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("typed", "text"),
    [
        ([], "agent is the only agent of a world"),
        (["--recorded"], "was trained without self-play"),
        (["--episodes", "0"], "episodes must be at least 1"),
        (["--max-players", "1"], "max_players must be at least 2"),
    ],
)
def test_what_cannot_be_played_is_refused(
    typed: list[str], text: str, alone: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["league", str(alone), *typed]) == 2
    assert text in capsys.readouterr().err


def test_a_corrupt_run_is_said_plainly(
    alone: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = Path(shutil.copytree(alone, tmp_path / "run"))
    for path in (run / "checkpoints").glob("*/tensors.safetensors"):
        path.write_bytes(b"no")
    assert main(["league", str(run)]) == 5
    assert "can be loaded" in capsys.readouterr().err
