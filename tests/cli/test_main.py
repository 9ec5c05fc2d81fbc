from __future__ import annotations

import os
import signal
import subprocess
import sys
import types
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest

from ludus.cli.main import COMMANDS, main
from ludus.errors import CheckpointError, ConfigError, EngineCrashed, EngineNotFound
from ludus.extras import EXTRAS, install_hint


@dataclass(frozen=True)
class Fake:
    """Pretend to do something.

    Attributes:
        times: How often.
    """

    times: int = 1


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[Fake], int]], None]:
    """Return what puts a function behind ``ludus bench``."""

    def install(run: Callable[[Fake], int]) -> None:
        module: Any = types.ModuleType("fake_command")
        module.COMMAND, module.run = Fake, run
        monkeypatch.setitem(sys.modules, "fake_command", module)
        monkeypatch.setitem(COMMANDS, "bench", ("fake_command", "fake"))

    return install


def raising(error: BaseException) -> Callable[[Fake], int]:
    def run(_: Fake) -> int:
        raise error

    return run


def test_help_lists_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    out = capsys.readouterr().out
    assert all(f"  {name} " in out for name in COMMANDS)


def test_no_command_shows_help_and_is_a_usage_error(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 2
    assert "usage: ludus COMMAND" in capsys.readouterr().out


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("ludus 0.")


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys; from ludus.cli import main; main(['--help'])\n"
        "heavy = {'torch', 'tyro', 'rich', 'matplotlib', 'tensorboard'} & set(sys.modules)\n"
        "sys.exit(repr(heavy) if heavy else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (0, b"")


def test_unknown_command_has_a_hint(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["trian"]) == 2
    error = capsys.readouterr().err
    assert error == "error: there is no command trian\nhint: did you mean train?\n"


def test_arguments_reach_the_command(command: Any) -> None:
    def run(fake: Fake) -> int:
        return fake.times

    command(run)
    assert main(["bench", "--times", "42"]) == 42


@pytest.mark.parametrize("arguments", [["--wrong"], ["--times", "x"], ["extra"]])
def test_wrong_flags_exit_2(
    arguments: list[str], command: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    command(raising(AssertionError("must not run")))
    assert main(["bench", *arguments]) == 2
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("error", "exit_code"),
    [
        (ConfigError("c", "do this"), 2),
        (EngineNotFound("c", "do this"), 3),
        (EngineCrashed("c", "do this"), 4),
        (CheckpointError("c", "do this"), 5),
    ],
)
def test_errors_are_one_block(
    error: Exception, exit_code: int, command: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    command(raising(error))
    assert main(["bench"]) == exit_code
    captured = capsys.readouterr()
    assert captured.err == "error: c\nhint: do this\n"
    assert captured.out == ""


def test_debug_shows_the_traceback(command: Any, capsys: pytest.CaptureFixture[str]) -> None:
    command(raising(ConfigError("c")))
    assert main(["bench", "--debug"]) == 2
    error = capsys.readouterr().err
    assert "Traceback" in error
    assert error.endswith("error: c\n")


def test_defects_tell_how_to_see_more(command: Any, capsys: pytest.CaptureFixture[str]) -> None:
    command(raising(ZeroDivisionError("oh")))
    assert main(["bench"]) == 1
    error = capsys.readouterr().err
    assert error.startswith("error: ZeroDivisionError: oh\nhint: ")
    assert "--debug" in error
    assert "Traceback" not in error


def test_a_missing_extra_is_named(command: Any, capsys: pytest.CaptureFixture[str]) -> None:
    command(raising(ModuleNotFoundError("No module named 'torch'", name="torch")))
    assert main(["bench"]) == 3
    error = capsys.readouterr().err
    assert error == f"error: torch is not installed\nhint: {install_hint('train')}\n"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("code", "package", "extra"),
    [
        ("ludus.load_policy", "torch", "train"),
        ("from ludus import train", "torch", "train"),
        ("from ludus.algorithms import Learner", "torch", "train"),
        ("from ludus.networks.tensors import as_tensor", "torch", "train"),
        ("import ludus.api.runners as own; own.OnnxRunner('x')", "onnxruntime", "export"),
        ("import ludus.sb3", "stable-baselines3", "sb3"),
        ("import ludus.pettingzoo", "pettingzoo", "pettingzoo"),
        ("import ludus.rllib", "ray[rllib]", "rllib"),
    ],
)
def test_python_names_the_extra_that_is_missing(code: str, package: str, extra: str) -> None:
    module = {"stable-baselines3": "stable_baselines3", "ray[rllib]": "ray"}.get(package, package)
    lines = f"import sys; sys.modules[{module!r}] = None\nimport ludus\n{code}"
    done = subprocess.run(
        [sys.executable, "-c", lines], capture_output=True, text=True, check=False
    )
    expected = f"MissingExtra: {package} is not installed\nhint: {install_hint(extra)}\n"
    assert done.stderr.endswith(expected), done.stderr


def test_the_extra_engine_brings_all_that_ludus_engine_needs() -> None:
    absent = set(EXTRAS) - {"platformdirs", "tyro", "rich"}  # tyro itself brings rich
    lines = f"""
import sys
class Absent:  # not None in sys.modules: tyro imports torch if it finds its name there
    def find_spec(self, name, *_):
        if name.partition(".")[0] in {absent}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Absent())
from ludus.cli.main import main
sys.exit(main(["engine", "list"]))
"""
    done = subprocess.run(
        [sys.executable, "-c", lines], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def test_ctrl_c(command: Any, capsys: pytest.CaptureFixture[str]) -> None:
    command(raising(KeyboardInterrupt()))
    assert main(["bench"]) == 130
    assert capsys.readouterr().err == "interrupted\n"


def test_sigterm_unwinds(command: Any) -> None:
    is_closed = False

    def run(_: Fake) -> int:
        nonlocal is_closed
        try:
            os.kill(os.getpid(), signal.SIGTERM)
            signal.pause()
        finally:
            is_closed = True
        return 0

    before = signal.getsignal(signal.SIGTERM)
    command(run)
    assert main(["bench"]) == 143
    assert is_closed
    assert signal.getsignal(signal.SIGTERM) is before


def test_a_closed_pipe_is_quiet() -> None:
    code = "import sys; from ludus.cli import main; sys.exit(main(['--help']))"
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run(
        [sys.executable, "-u", "-c", code], stdout=writer, stderr=subprocess.PIPE, check=False
    )
    os.close(writer)
    assert (done.returncode, done.stderr) == (141, b"")
