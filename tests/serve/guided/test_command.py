"""``ludus serve`` as a command: its log, and what ends it before a game has come."""

from __future__ import annotations

from pathlib import Path

import pytest

from ludus.cli.main import main
from tests.serve.guided.conftest import Running


def test_the_last_line_of_the_log_says_what_ended_it(
    server: Running, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "logs" / "serve.log"
    arguments = ["serve", "--port", str(server.port), "--runs", str(tmp_path / "r")]
    assert main([*arguments, "--log", str(log)]) == 3
    error = f"cannot listen at 127.0.0.1:{server.port}"
    assert f"error: {error}" in capsys.readouterr().err
    last = log.read_text().splitlines()[-1]
    assert error in last
    assert "; hint: another ludus serve or ludus train is there" in last


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (("--seed", "-1"), "seed must be from 0"),
        (("--torch-threads", "0"), "--torch-threads at least 1"),
        (("--message-timeout-s", "0"), "--message-timeout-s must be above 0"),
        (("--device", "abacus"), "abacus"),
    ],
)
def test_options_out_of_range_are_refused(
    options: tuple[str, ...], text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["serve", "--port", "0", "--runs", str(tmp_path / "runs"), *options]) == 2
    assert text in capsys.readouterr().err


def test_a_runs_folder_that_cannot_be_created_is_an_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    assert main(["serve", "--port", "0", "--runs", str(tmp_path / "file" / "runs")]) == 5
    assert "the folder of the runs" in capsys.readouterr().err
