from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from ludus.cli.main import main
from tests.legacy.godot_ai.conftest import DEADLINE_S, Client, await_work, replays, saved_steps


def test_unknown_bridge_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["serve", "--bridge", "godot-rl"]) == 2
    output = capsys.readouterr().err
    assert "there is no bridge 'godot-rl'" in output
    assert "hint: write --bridge ludus or --bridge godot-ai" in output
    assert "--dialect" not in output


def test_dialect_names_the_new_flag(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    missing = str(tmp_path / "x")
    assert main(["serve", "--dialect", "godot-ai", "--project", missing]) == 2
    output = capsys.readouterr().err
    assert output.startswith("--dialect is now called --bridge\n")
    assert "there is no folder" in output


@pytest.mark.parametrize(
    ("bridge", "option", "other"),
    [
        ("ludus", ("--project", "."), "godot-ai"),
        ("godot-ai", ("--runs", "runs"), "ludus"),
        ("godot-ai", ("--policies", "policies"), "ludus"),
        ("godot-ai", ("--once",), "ludus"),
    ],
)
def test_options_of_another_bridge_are_refused(
    bridge: str, option: tuple[str, ...], other: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["serve", "--bridge", bridge, *option]) == 2
    output = capsys.readouterr().err
    assert f"{option[0]} is not an option of --bridge {bridge}" in output
    assert f"hint: it is an option of --bridge {other}" in output


def test_a_folder_must_be_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["serve", "--bridge", "godot-ai", "--project", str(tmp_path / "x")]) == 2
    assert "there is no folder" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("signum", [signal.SIGINT, signal.SIGTERM])
def test_signals_save_and_end_it(tmp_path: Path, signum: signal.Signals) -> None:
    (tmp_path / "project.godot").touch()
    arguments = ["serve", "--bridge", "godot-ai", "--project", str(tmp_path), "--port", "0"]
    log = tmp_path / "log"
    with log.open("wb") as output:
        process = subprocess.Popen([sys.executable, "-m", "ludus.cli", *arguments], stderr=output)
    try:
        client = Client(_port(log, process), tmp_path)
        assert client.init() == {"done": True}
        assert client.submit(replays(40)) == {"done": True}
        assert client.train(1) == {"done": True}
        client.send(json.dumps({"command": "train", "file_name": "hero", "steps": 10**6}).encode())
        await_work(process.pid, 0.5)
        process.send_signal(signum)
        assert process.wait(DEADLINE_S) == 128 + signum
        client.close()
    finally:
        process.kill()
        process.wait()
    assert 1 < saved_steps(tmp_path) < 10**6
    assert "Traceback" not in log.read_text()


def _port(log: Path, process: subprocess.Popen[bytes]) -> int:
    deadline = time.monotonic() + DEADLINE_S
    while time.monotonic() < deadline and process.poll() is None:
        for line in log.read_text().splitlines():
            if line.startswith("serving godot-ai games in"):
                return int(line.rpartition(":")[2])
        time.sleep(0.05)
    raise AssertionError(log.read_text())
