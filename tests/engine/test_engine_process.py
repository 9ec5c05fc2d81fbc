"""Supervising processes: nothing blocks, nothing is left behind, every death is explained."""

from __future__ import annotations

import ctypes
import gc
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest

from ludus.engine.find import InstalledEngine
from ludus.engine.importing import ensure_imported
from ludus.engine.kinds import EngineKind
from ludus.engine.launch import (
    GodotFlags,
    LaunchConfig,
    executable_command,
    godot_command,
    with_display,
)
from ludus.engine.process import EngineProcess
from ludus.engine.project import find_project
from ludus.errors import ConfigError, EngineStartError

FAMILY = """
import subprocess, sys, time
depth = int(sys.argv[1])
if depth:
    child = subprocess.Popen([sys.executable, __file__, str(depth - 1)])
print("up", depth, flush=True)
time.sleep(100)
"""
STUBBORN = """
import signal, time
signal.signal(signal.SIGTERM, signal.SIG_IGN)
print("ready", flush=True)
time.sleep(100)
"""
OWNER = """
import os, sys, time
from ludus.engine.launch import LaunchConfig
from ludus.engine.process import EngineProcess
process = EngineProcess.start(LaunchConfig(command=(sys.executable, {family!r}, "1")))
while len(process.last_lines()) < 2:
    time.sleep(0.01)
print(process.pid, flush=True)
{ending}
"""


def python(code: str, *arguments: str, **settings: object) -> LaunchConfig:
    command = (sys.executable, "-c", code, *arguments)
    return LaunchConfig(command=command, **settings)  # pyright: ignore[reportArgumentType]


def output_of(code: str, **settings: object) -> list[str]:
    """Return the last lines of a process that ends well."""
    with EngineProcess.start(python(code, **settings)) as process:
        assert process.wait(60) == 0
        return process.last_lines()


def until(condition: Callable[[], bool], timeout_s: float = 20.0) -> None:
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.01)


def group_members(group: int) -> list[int]:
    """List living processes of a group; zombies that init has yet to reap do not count."""
    members: list[int] = []
    for process in psutil.process_iter(["status"]):
        try:
            if os.getpgid(process.pid) == group and process.status() != psutil.STATUS_ZOMBIE:
                members.append(process.pid)
        except (ProcessLookupError, psutil.NoSuchProcess):
            continue
    return members


@pytest.fixture
def family(tmp_path: Path) -> Path:
    script = tmp_path / "family.py"
    script.write_text(FAMILY)
    return script


def start_family(script: Path) -> EngineProcess:
    process = EngineProcess.start(LaunchConfig(command=(sys.executable, str(script), "2")))
    until(lambda: len(process.last_lines()) == 3)
    assert len(group_members(process.pid)) == 3
    return process


def test_exit_code_and_output_are_kept() -> None:
    process = EngineProcess.start(python("print('a'); print('b'); raise SystemExit(3)"))
    assert process.wait(20) == process.poll() == 3
    assert not process.is_alive
    report = process.describe_death()
    assert report.startswith("the process ended with exit code 3\ncommand: ")
    assert report.endswith("last lines of its output:\n  | a\n  | b")
    assert process.last_lines(1) == ["b"]
    process.terminate()


def test_whole_family_is_ended(family: Path) -> None:
    process = start_family(family)
    process.terminate()
    until(lambda: not group_members(process.pid))
    assert process.poll() == -signal.SIGTERM
    process.terminate()


def test_death_of_the_first_ends_the_rest(family: Path) -> None:
    process = start_family(family)
    os.kill(process.pid, signal.SIGKILL)
    until(lambda: not process.is_alive)
    until(lambda: not group_members(process.pid))
    assert "killed by SIGKILL" in process.describe_death()
    process.terminate()


def test_process_that_ignores_sigterm_is_killed() -> None:
    process = EngineProcess.start(python(STUBBORN, grace_s=0.2))
    until(lambda: process.last_lines() == ["ready"])
    process.terminate()
    assert process.poll() == -signal.SIGKILL


def test_polite_end_is_given_time() -> None:
    code = (
        "import signal, sys, time\n"
        "def leave(*_):\n    time.sleep(0.2)\n    sys.exit(7)\n"
        "signal.signal(signal.SIGTERM, leave)\n"
        "print('ready', flush=True)\n"
        "while True:\n    time.sleep(1)\n"
    )
    with EngineProcess.start(python(code)) as process:
        until(lambda: process.last_lines() == ["ready"])
    assert process.poll() == 7


def test_rest_of_the_family_may_tidy_up(tmp_path: Path) -> None:
    tidy = tmp_path / "tidy.py"
    tidy.write_text(
        "import signal, sys, time\n"
        "def leave(*_):\n    time.sleep(0.1)\n    open(sys.argv[1], 'w').close()\n    sys.exit()\n"
        "signal.signal(signal.SIGTERM, leave)\n"
        "print('ready', flush=True)\n"
        "while True:\n    time.sleep(1)\n"
    )
    mark = tmp_path / "tidied"
    code = f"import subprocess, sys; subprocess.run([sys.executable, {str(tidy)!r}, {str(mark)!r}])"
    with EngineProcess.start(python(code)) as process:
        until(lambda: process.last_lines() == ["ready"])
    assert mark.exists()
    until(lambda: not group_members(process.pid))


def test_once_it_has_ended_the_last_line_is_there() -> None:
    code = "import os; os.write(1, b'line\\n' * 12000); os.write(1, b'end\\n')"
    for _ in range(10):
        assert output_of(code)[-1] == "end"


def test_chatty_process_never_blocks() -> None:
    lines = output_of("for i in range(50000): print('line', i)", num_last_lines=50)
    assert lines == [f"line {i}" for i in range(49950, 50000)]


@pytest.mark.parametrize(
    ("code", "expected"),
    [
        pytest.param(
            "import sys\nfor _ in range(500): sys.stdout.write('x' * 10000)\nsys.stdout.flush()",
            ["x" * 4000],
            id="an endless line is bounded",
        ),
        pytest.param(
            r"import os; os.write(1, b'\xff\xfeok\r\n')",
            ["\ufffd\ufffdok"],
            id="bytes that are no text are shown",
        ),
    ],
)
def test_last_lines_of_odd_output(code: str, expected: list[str]) -> None:
    assert output_of(code) == expected


def test_script_errors_are_shown_even_if_much_followed() -> None:
    code = (
        "print('SCRIPT ERROR: bad call')\n"
        "print('   at: step (res://hero.gd:12)')\n"
        "for i in range(100): print('noise', i)\n"
    )
    with EngineProcess.start(python(code)) as process:
        process.wait(20)
        report = process.describe_death()
    assert "  ! SCRIPT ERROR: bad call\n  !    at: step (res://hero.gd:12)" in report
    assert report.endswith("  | noise 99")
    assert "noise 79" not in report


def test_a_script_error_of_every_tick_stands_there_once() -> None:
    code = (
        "for i in range(50):\n"
        "    print('SCRIPT ERROR: bad call')\n"
        "    print('   at: step (res://hero.gd:12)')\n"
        "    print('noise', i)\n"
        "    print('SCRIPT ERROR: bad call')\n"
        "    print('   at: jump (res://hero.gd:40)')\n"
    )
    with EngineProcess.start(python(code)) as process:
        process.wait(20)
        process.describe_death()
        assert process.script_errors == [
            "SCRIPT ERROR: bad call",
            "   at: step (res://hero.gd:12)",
            "SCRIPT ERROR: bad call",
            "   at: jump (res://hero.gd:40)",
        ]


def test_log_file_gets_everything(tmp_path: Path) -> None:
    log = tmp_path / "deep" / "engine.log"
    for _ in range(2):
        output_of("print('hello')", log_path=log)
    assert log.read_bytes() == b"hello\nhello\n"


@pytest.mark.parametrize("log", ["/dev/full", "/dev/null/x.log"])
def test_log_that_cannot_be_written_stops_nothing(
    log: str, caplog: pytest.LogCaptureFixture
) -> None:
    code = "for i in range(20000): print('line', i)"
    assert output_of(code, log_path=Path(log))[-1] == "line 19999"
    assert "log" in caplog.text


@pytest.mark.parametrize("name", ["missing", "not-executable", "."])
def test_program_that_cannot_start_is_reported(tmp_path: Path, name: str) -> None:
    (tmp_path / "not-executable").touch()
    with pytest.raises(EngineStartError, match="command: ") as caught:
        EngineProcess.start(LaunchConfig(command=(str(tmp_path / name), "--flag")))
    assert "--flag" in caught.value.message


def test_environment_and_folder_are_set(tmp_path: Path) -> None:
    code = "import os; print(os.getcwd(), os.environ['LUDUS_X'], 'PATH' in os.environ)"
    assert output_of(code, folder=tmp_path, env={"LUDUS_X": "7"}) == [f"{tmp_path} 7 True"]


def test_every_thread_is_pinned_and_we_are_not() -> None:
    before = os.sched_getaffinity(0)
    core = max(before)
    code = (
        "import os, threading\n"
        "def show(): print(sorted(os.sched_getaffinity(0)), flush=True)\n"
        "show()\nthread = threading.Thread(target=show)\nthread.start()\nthread.join()\n"
    )
    assert output_of(code, cores=(core,)) == [f"[{core}]"] * 2
    assert os.sched_getaffinity(0) == before


def test_pinning_to_missing_cores_is_refused() -> None:
    before = os.sched_getaffinity(0)
    with pytest.raises(ConfigError, match="9999"):
        EngineProcess.start(python("pass", cores=(9999,)))
    assert os.sched_getaffinity(0) == before


def test_forgotten_process_is_ended(family: Path) -> None:
    process = start_family(family)
    pid = process.pid
    del process
    gc.collect()
    until(lambda: not group_members(pid))


@pytest.mark.slow
@pytest.mark.parametrize(
    "ending",
    [
        "",
        "raise RuntimeError('oops')",
        "sys.exit(3)",
        "import signal; signal.raise_signal(signal.SIGINT); time.sleep(20)",
    ],
)
def test_no_orphans_when_python_ends(family: Path, ending: str) -> None:
    script = OWNER.format(family=str(family), ending=ending)
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, timeout=60, check=False
    )
    pid = int(done.stdout)
    until(lambda: not group_members(pid))


def _use_in_fork(process: EngineProcess) -> None:
    process.terminate()
    assert process.poll() is None


def test_forked_copy_ends_nothing() -> None:
    with EngineProcess.start(python("import time; time.sleep(100)")) as process:
        child = multiprocessing.get_context("fork").Process(target=_use_in_fork, args=(process,))
        child.start()
        child.join(30)
        assert child.exitcode == 0
        assert process.is_alive
    assert process.poll() == -signal.SIGTERM


def test_many_threads_may_watch_one_process() -> None:
    process = EngineProcess.start(python("import time; time.sleep(0.3)"))
    codes: list[int | None] = []
    threads = [threading.Thread(target=lambda: codes.append(process.wait(20))) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert codes == [0] * 8
    process.terminate()


def test_commands_of_both_godots(tmp_path: Path) -> None:
    server, window = tmp_path / "server", tmp_path / "window"
    godot4 = InstalledEngine(EngineKind.GODOT4, server, (4, 6), "4.6", "test")
    godot3 = InstalledEngine(EngineKind.GODOT3, server, (3, 6), "3.6", "test", window)
    flags = GodotFlags(user_args=("--ludus-a",))
    windowed = GodotFlags(headless=False, user_args=("--ludus-a",))
    end = ("--path", "game", "res://a.tscn", "--", "--ludus-a")
    game = Path("game")
    assert godot_command(godot4, game, "res://a.tscn", flags) == (
        str(server), "--headless", "--fixed-fps", "60", *end
    )  # fmt: skip
    assert godot_command(godot4, game, "res://a.tscn", windowed) == (
        str(server), "--rendering-driver", "opengl3", "--disable-vsync", "--audio-driver", "Dummy",
        "--fixed-fps", "60", *end
    )  # fmt: skip
    assert godot_command(godot3, game, "res://a.tscn", flags)[:3] == (
        str(server), "--fixed-fps", "60"
    )  # fmt: skip
    assert godot_command(godot3, game, None, windowed)[0] == str(window)
    editor = InstalledEngine(EngineKind.GODOT3, tmp_path / "godot3", (3, 6), "3.6", "test")
    unseen = ("--no-window", "--disable-render-loop", "--fixed-fps", "60", *end)
    assert godot_command(editor, game, "res://a.tscn", flags)[-len(unseen) :] == unseen
    assert "--no-window" not in godot_command(editor, game, None, windowed)
    assert executable_command(server, flags) == (
        str(server), "--headless", "--fixed-fps", "60", "--", "--ludus-a"
    )  # fmt: skip


@pytest.fixture
def foster_parent() -> Iterator[None]:
    """Make this process the parent of orphans, in place of the machine's first process."""
    set_child_subreaper = 36  # prctl(2)
    ctypes.CDLL(None).prctl(set_child_subreaper, 1)
    yield
    ctypes.CDLL(None).prctl(set_child_subreaper, 0)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has subreapers")
@pytest.mark.usefixtures("foster_parent")
def test_dead_orphans_are_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ludus.engine.process_group._REST_GRACE_S", 30.0)
    command = ("/bin/sh", "-c", "sleep 60 & exec sleep 60")
    process = EngineProcess.start(LaunchConfig(command=command))
    until(lambda: len(group_members(process.pid)) == 2)
    [orphan] = set(group_members(process.pid)) - {process.pid}
    start = time.monotonic()
    process.terminate()
    assert time.monotonic() < start + 20.0
    assert os.waitpid(orphan, os.WNOHANG)[0] == orphan, "nobody else has reaped it"


@pytest.mark.engine
@pytest.mark.screen
def test_a_screen_leaves_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    command = with_display(("/bin/sh", "-c", "echo screen $DISPLAY; exec sleep 60"))
    with EngineProcess.start(LaunchConfig(command=command)) as process:
        until(lambda: process.last_lines() != [])
        assert process.last_lines()[0].startswith("screen :")
        assert len(list(tmp_path.iterdir())) == 1
        assert len(group_members(process.pid)) > 2
    assert list(tmp_path.iterdir()) == []
    assert not group_members(process.pid)


@pytest.mark.engine
def test_real_engine_runs_pinned_and_is_ended(
    godot4: InstalledEngine, tiny_project: Path, tmp_path: Path
) -> None:
    ensure_imported(godot4, find_project(tiny_project))
    core = max(os.sched_getaffinity(0))
    command = godot_command(godot4, tiny_project, None, GodotFlags(user_args=("--ludus-x",)))
    config = LaunchConfig(command=command, cores=(core,), log_path=tmp_path / "log")
    with EngineProcess.start(config) as process:
        until(lambda: "tiny 7" in process.last_lines())
        threads = [int(entry.name) for entry in Path(f"/proc/{process.pid}/task").iterdir()]
        assert len(threads) > 1
        assert {tuple(os.sched_getaffinity(thread)) for thread in threads} == {(core,)}
        assert "godot" in psutil.Process(process.pid).cmdline()
        assert process.is_alive
    assert process.poll() == -signal.SIGTERM
    assert not group_members(process.pid)
    assert b"tiny 7" in (tmp_path / "log").read_bytes()


@pytest.mark.engine
def test_real_engine_that_cannot_start_explains_itself(
    godot4: InstalledEngine, tmp_path: Path
) -> None:
    command = godot_command(godot4, tmp_path / "nowhere", None, GodotFlags())
    with EngineProcess.start(LaunchConfig(command=command)) as process:
        assert process.wait(30) not in {None, 0}
        report = process.describe_death()
    assert "exit code 1" in report
    assert str(tmp_path / "nowhere") in report
