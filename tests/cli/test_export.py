"""``ludus export``, and ``ludus play --in-engine``: what they refuse, print and play."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from ludus.cli.main import main
from ludus.engine.bundled import bundled_root
from ludus.extras import install_hint
from tests.export.trained_runs import MIXED, SIMPLE, make_policy, make_run

FIGURE = r"(0|\d\.\de-\d+)"


@pytest.fixture
def run(tmp_path: Path) -> Path:
    policies = {"hero": make_policy(SIMPLE), "mixed": make_policy(MIXED, seed=1)}
    return make_run(tmp_path / "run", policies)


@pytest.mark.parametrize(
    ("arguments", "exit_code", "what", "hint"),
    [
        (["--to", "m.pt"], 2, "cannot export to m.pt", "end it in .ludus.json"),
        (["--to", "m.json"], 2, "cannot export to m.json", "did you mean m.ludus.json?"),
        (["--to", "m.onnx"], 2, "cannot all be written to m.onnx", "choose one by --policy"),
        (["--policy", "heero"], 2, "has no policy heero", "did you mean hero?"),
        (["--policy", "zzz"], 2, "has no policy zzz", "its policies: hero, mixed"),
        (["--checkpoint", "x"], 5, "there is no checkpoint x", "check the path"),
    ],
)
def test_bad_input_is_one_error_and_a_hint(
    arguments: list[str],
    exit_code: int,
    what: str,
    hint: str,
    run: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["export", str(run), "--no-parity", *arguments]) == exit_code
    captured = capsys.readouterr()
    assert captured.out == ""
    error, told = captured.err.splitlines()
    assert error.startswith("error: ") and what in error
    assert told.startswith("hint: ") and hint in told


def test_what_is_no_run_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", str(tmp_path)]) == 5
    assert "is not a run" in capsys.readouterr().err


def test_a_corrupt_run_is_refused(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (checkpoint,) = (run / "checkpoints").iterdir()
    (checkpoint / "state.json").write_text("{")
    assert main(["export", str(run), "--checkpoint", checkpoint.name]) == 5
    error = capsys.readouterr().err
    assert f"{checkpoint} is corrupt" in error and "hint: " in error


@pytest.mark.slow
def test_onnx_that_is_not_installed_is_named(run: Path) -> None:
    code = (
        "import sys; sys.modules['onnx'] = None\n"
        "from ludus.cli import main\n"
        f"sys.exit(main(['export', {str(run)!r}, '--no-parity', '--to', '{{policy}}.onnx']))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=run
    )
    assert done.returncode == 3, done.stderr
    assert done.stderr == f"error: onnx is not installed\nhint: {install_hint('export')}\n"
    assert not list(run.glob("*.onnx"))


def test_paths_and_sizes_are_printed(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", str(run), "--no-parity"]) == 0
    first, note, *_ = capsys.readouterr().out.splitlines()
    path = run / "hero.ludus.json"
    assert first == f"hero: {path} ({path.stat().st_size / 1024:.1f} KiB)"
    assert note == "  not tested (--no-parity)"


@pytest.mark.engine
def test_all_runtimes_agree_about_every_policy(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", str(run), "--to", f"{run}/files/{{policy}}.ludus.json"]) == 0
    require_parity_lines(capsys.readouterr().out, 2)
    names = sorted(path.name for path in (run / "files").iterdir())
    assert names == ["hero.ludus.json", "mixed.ludus.json"]


def require_parity_lines(output: str, num_policies: int, godot: int = 4) -> None:
    for runtime in ("NumPy", "ONNX Runtime", rf"Godot {godot}\.\S+"):
        line = rf"^    {runtime} +outputs {FIGURE}, actions {FIGURE}"
        found = re.findall(line, output, re.M)
        assert len(found) == num_policies, output
        assert all(float(figure) <= 1e-4 for figures in found for figure in figures), output


# --- playing in the engine ----------------------------------------------------------------------


@pytest.mark.parametrize("flags", [[], ["--random"]])
def test_only_runs_are_played_in_the_engine(
    flags: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    game = str(bundled_root() / "examples/identity/oracle.tscn")
    assert main(["play", game, "--in-engine", "--headless", *flags]) == 2
    error = capsys.readouterr().err
    assert "--in-engine needs the trained agents of a run\nhint: name a run folder" in error


def test_a_target_that_is_not_there_is_named(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["play", str(run), "--in-engine", "--headless"]) == 2
    assert "no example, file or folder called 'nowhere'" in capsys.readouterr().err


@pytest.mark.engine
@pytest.mark.parametrize("godot", [4, 3])
def test_cartpole_from_training_to_the_engine(
    godot: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target = f"godot{godot}:cartpole"
    train = ["train", target, "--runs", str(tmp_path), "--name", "r", "--total-steps", "4096"]
    assert main([*train, "--num-worlds", "16", "--evaluation-episodes", "0"]) == 0
    capsys.readouterr()
    run = str(tmp_path / "r")
    assert main(["export", run]) == 0
    require_parity_lines(capsys.readouterr().out, 1, godot)
    assert (tmp_path / "r/cart.ludus.json").is_file()
    for flags in ([], ["--stochastic"]):
        play = ["play", run, "--in-engine", "--headless", "--episodes", "3"]
        assert main([*play, *flags]) == 0
        *lines, mean = capsys.readouterr().out.splitlines()
        assert re.fullmatch(r"cart: mean return [\d.]+ of 3 episodes", mean)
        found = [
            re.fullmatch(r"cart: episode (\d), return (\d+) in (\d+) steps", line) for line in lines
        ]
        assert [match and match[1] for match in found] == ["1", "2", "3"], lines
        assert all(match and match[2] == match[3] for match in found), lines


@pytest.mark.engine
def test_ctrl_c_ends_game_and_command(tmp_path: Path) -> None:
    train = ["train", "cartpole", "--runs", str(tmp_path), "--name", "r", "--total-steps", "256"]
    assert main([*train, "--num-worlds", "4", "--evaluation-episodes", "0"]) == 0
    play = ["play", str(tmp_path / "r"), "--in-engine", "--headless", "--episodes", "1000000"]
    command = [sys.executable, "-u", "-m", "ludus.cli", *play]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    try:
        assert process.stdout is not None
        assert process.stdout.readline().startswith(b"cart: episode 1, ")
        children = psutil.Process(process.pid).children(recursive=True)
        assert children
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=60)
    finally:
        process.kill()
    assert (process.returncode, error) == (130, b"interrupted\n")
    _, alive = psutil.wait_procs(children, timeout=30)
    assert alive == []
