"""``ludus runs`` over runs of all kinds."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from ludus.cli.main import main

SMALL = [
    "gym:CartPole-v1", "--num-worlds", "4", "--num-engines", "1", "--total-steps", "2048",
    "--ppo.rollout-steps", "32", "--ppo.hidden-sizes", "8", "--seed", "1",
]  # fmt: skip


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the runs ``first`` and ``second`` (that one evaluated), and other things."""
    folder = tmp_path_factory.mktemp("runs")
    for name, episodes in (("first", "0"), ("second", "3")):
        typed = ["--runs", str(folder), "--name", name, "--evaluation-episodes", episodes]
        assert main(["train", *SMALL, *typed]) == 0
    (folder / "notes.txt").write_text("mine")
    (folder / "other").mkdir()
    return folder


def test_a_line_for_each_run_and_policy(runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["runs", str(runs)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 4
    assert lines[0].split()[:3] == ["second", "finished", "gym:CartPole-v1"]
    assert "2,048 steps in" in lines[0]
    assert lines[1].split()[0] == "agent"
    assert "█" in lines[1]
    assert "mean return" in lines[1]
    assert "evaluation" in lines[1]
    assert lines[2].startswith("first ")
    assert "evaluation" not in lines[3]


def test_json_lists_every_run(runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["runs", str(runs), "--json"]) == 0
    second, first = json.loads(capsys.readouterr().out)["runs"]
    assert (first["name"], first["state"], first["stop_reason"]) == (
        "first", "finished", "total_steps",
    )  # fmt: skip
    assert (first["agent_steps"], first["updates"]) == (2048, 16)
    assert first["policies"]["agent"]["mean_return"] == first["policies"]["agent"]["curve"][-1]
    assert first["policies"]["agent"]["evaluation"] is None
    assert second["policies"]["agent"]["evaluation"] > 0


@pytest.mark.parametrize("folder", ["nowhere", "empty"])
def test_no_runs_is_no_error(
    folder: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "empty").mkdir()
    assert main(["runs", str(tmp_path / folder)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2
    assert "there are no runs in" in lines[0]
    assert lines[1].startswith("hint: ")
    assert main(["runs", str(tmp_path / folder), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"runs": []}


def test_listing_imports_neither_torch_nor_numpy(runs: Path) -> None:
    code = f"""if True:
        import sys
        from ludus.cli.main import main
        assert main(["runs", {str(runs)!r}]) == 0
        heavy = {{"torch", "numpy", "gymnasium", "tensorboard", "matplotlib"}} & sys.modules.keys()
        assert not heavy, heavy
    """
    arguments = [sys.executable, "-c", code]
    listing = subprocess.run(arguments, check=False, capture_output=True, text=True)
    assert listing.returncode == 0, listing.stderr
    assert "second" in listing.stdout


def test_a_file_is_no_folder(runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["runs", str(runs / "notes.txt")]) == 2
    assert "cannot list" in capsys.readouterr().err


@pytest.mark.slow
def test_a_killed_run_has_crashed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    typed = [*SMALL, "--runs", str(tmp_path), "--name", "r", "--total-steps", "100000000"]
    child = subprocess.Popen(
        [sys.executable, "-u", "-m", "ludus.cli", "train", *typed],
        stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert child.stderr is not None
    try:
        while "mean return" not in (line := child.stderr.readline()):
            assert line
        assert main(["runs", str(tmp_path), "--json"]) == 0
        (run,) = json.loads(capsys.readouterr().out)["runs"]
        assert (run["state"], run["stop_reason"]) == ("running", None)
        assert run["agent_steps"] > 0
    finally:
        child.kill()
        child.communicate()
    assert main(["runs", str(tmp_path)]) == 0
    assert capsys.readouterr().out.split()[:2] == ["r", "crashed"]
