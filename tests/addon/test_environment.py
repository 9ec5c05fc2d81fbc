"""A project's own virtual environment: whole or absent, and who made the add-on stays private."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import pytest

from ludus.addon import environment
from ludus.cli.main import main
from ludus.errors import ConfigError, SetupError
from tests.godot_project import write_project

pytestmark = pytest.mark.slow


@pytest.fixture
def project(tmp_path: Path) -> Path:
    return write_project(tmp_path / "game", {}, main="game")


@pytest.fixture
def wheel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package without needs, in the place of Ludus."""
    path = tmp_path / "tiny-1.0-py3-none-any.whl"
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("tiny.py", "VALUE = 7\n")
        info = "tiny-1.0.dist-info"
        file.writestr(f"{info}/METADATA", "Metadata-Version: 2.1\nName: tiny\nVersion: 1.0\n")
        file.writestr(f"{info}/WHEEL", "Wheel-Version: 1.0\nGenerator: t\nRoot-Is-Purelib: true\n")
        file.writestr(f"{info}/RECORD", "tiny.py,,\n")
    monkeypatch.setattr(environment, "requirement", lambda: str(path))
    return path


def test_it_has_what_was_asked_for(
    project: Path, wheel: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert main(["addon", "environment", str(project)]) == 0
    said = capfd.readouterr().out
    assert f"{project / '.venv'} takes about " in said
    python = project / ".venv/bin/python"
    seen = subprocess.run(
        [python, "-c", "import tiny; print(tiny.VALUE)"], capture_output=True, check=True
    )
    assert seen.stdout == b"7\n"
    assert (project / ".venv/.gdignore").exists(), "the editor does not look into it"
    with pytest.raises(ConfigError, match="exists already"):
        environment.make_environment(project)
    assert python.exists()


def test_the_size_is_told_without_making_anything(
    project: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert main(["addon", "environment", str(project), "--size"]) == 0
    (megabytes,) = [int(w) for w in capfd.readouterr().out.split() if w.isdigit()]
    assert megabytes > 200, "PyTorch alone is larger"
    assert not (project / ".venv").exists()


def test_nothing_is_left_where_a_package_is_missing(project: Path, wheel: Path) -> None:
    wheel.unlink()
    with pytest.raises(SetupError, match="pip could not install"):
        environment.make_environment(project)
    assert not (project / ".venv").exists()


STUCK = """\
import sys
from pathlib import Path
from ludus.addon import environment
import venv
without_pip = venv.EnvBuilder()  # bringing pip takes four seconds
venv.EnvBuilder = lambda with_pip: without_pip
def wait(python, what):
    print("installing", flush=True)
    import time
    time.sleep(600)
environment._install = wait
from ludus.cli.main import main
sys.exit(main(["addon", "environment", sys.argv[1]]))
"""


@pytest.mark.skipif(os.name != "posix", reason="no such signals elsewhere")
@pytest.mark.parametrize("sign", [signal.SIGTERM, signal.SIGKILL])
def test_nothing_is_left_of_one_that_was_interrupted(
    project: Path, wheel: Path, sign: signal.Signals
) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", STUCK, str(project)], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if line == "installing\n":
                break
        time.sleep(0.1)
        process.send_signal(sign)
        process.wait(60)
    if sign is signal.SIGTERM:
        assert not (project / ".venv").exists()
    else:  # what a killed one has left is taken away by the next
        assert (project / ".venv").exists()
        environment.make_environment(project)
        assert not (project / ".venv" / environment.UNFINISHED).exists()


def test_the_project_does_not_say_who_installed_the_add_on(project: Path) -> None:
    assert main(["addon", "install", str(project)]) == 0
    assert environment.installer_file().read_text() == sys.executable + "\n"
    for file in project.rglob("*"):
        if file.is_file():
            assert sys.executable.encode() not in file.read_bytes(), file


def test_this_ludus_is_required_as_it_is_installed() -> None:
    what = environment.requirement()
    assert what.startswith("ludus-rl[train,record]")
    assert " @ file://" in what or "==" in what
