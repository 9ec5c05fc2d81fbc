"""Forms of Windows that can be told on any system: command lines, paths, ends of processes."""

from __future__ import annotations

import subprocess
from pathlib import PurePosixPath, PureWindowsPath
from types import SimpleNamespace
from typing import Any

import pytest

from ludus.engine import process, process_group
from ludus.engine.process_group import ProcessGroup, windows_command_line
from ludus.errors import ProtocolError, TargetError
from ludus.legacy import launching
from ludus.legacy.addresses import GameAddress, read_address
from ludus.legacy.launching import GameLaunch
from ludus.serve.godot_ai.project_files import ProjectFiles, has_foreign_drive
from ludus.target import Legacy, parse_target

EXE_CMD = r'cd /d "D:\my games" && "C:\Program Files\Godot\godot.exe" --no-window Root.tscn'


def test_a_command_reaches_cmd_with_its_quotes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(launching, "_IS_POSIX", False)
    command = GameLaunch(command=EXE_CMD).command_line(
        ("--serverPort=8000", r"--renderPath=C:\a b\frames" + "\\")
    )
    # cmd takes off the first and the last quote, since /s is given, and reads what is between.
    assert windows_command_line(command) == (
        f'cmd /d /s /c "{EXE_CMD} --fixed-fps 60 --disable-render-loop --serverPort=8000 '
        r'"--renderPath=C:\a b\frames\\""'
    )


def test_other_commands_are_quoted_for_programs() -> None:
    typed = [r"C:\Program Files\godot.exe", "--path", r"C:\game", 'say "a"']
    assert windows_command_line(typed) == (
        r'"C:\Program Files\godot.exe" --path C:\game "say \"a\""'
    )


@pytest.mark.parametrize("text", [r"C:\games\cart", "C:/games/cart/Root.tscn", r"\\pc\games", "C:"])
def test_a_path_with_a_drive_is_no_address(text: str) -> None:
    assert parse_target(f"gymgodot:{text}") == Legacy(f"gymgodot:{text}")
    with pytest.raises(TargetError, match="no project and no scene"):
        read_address(GameAddress(address=text))


@pytest.mark.parametrize(
    ("path", "is_foreign"),
    [
        (r"AIServerCommFiles\states.json", False),
        ("AIServerCommFiles/states.json", False),
        (r"C:\Game\AIServerCommFiles\states.json", False),
        ("c:/game/states.json", False),
        (r"D:\game\states.json", True),
        ("D:states.json", True),
        (r"\\server\share\states.json", True),
        ("//server/share/states.json", True),
        (r"\\?\C:\game\states.json", True),
        (r"\\.\pipe\states", True),
    ],
)
def test_messages_name_no_other_drive_and_no_other_machine(path: str, is_foreign: bool) -> None:
    assert has_foreign_drive(PureWindowsPath(r"C:\Game"), path) is is_foreign
    assert not has_foreign_drive(PurePosixPath("/game"), path)


def test_another_drive_is_refused_before_it_is_looked_for(
    tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = ProjectFiles(tmp_path)
    monkeypatch.setattr(files, "root", PureWindowsPath(r"C:\game"))  # which cannot be resolved
    with pytest.raises(ProtocolError, match="leads out of the project"):
        files.find(r"\\server\share\states.json")


def test_a_process_is_ended_with_what_it_has_started(monkeypatch: pytest.MonkeyPatch) -> None:
    group = ProcessGroup(["sleep", "60"], {}, None)
    pid = group.pid
    asked: list[list[str]] = []

    def run(command: list[str], **_: Any) -> None:
        asked.append(command)
        group.popen.kill()

    windows = SimpleNamespace(platform="win32")
    fake = SimpleNamespace(run=run, DEVNULL=subprocess.DEVNULL)
    with monkeypatch.context() as patch:
        patch.setattr(process_group, "sys", windows)
        patch.setattr(process_group, "subprocess", fake)
        group.terminate(5.0)
        assert group.poll() is not None
    assert group.popen.stdout is not None
    group.popen.stdout.close()
    assert asked[0] == ["taskkill", "/F", "/T", "/PID", str(pid)]


@pytest.mark.parametrize(
    ("code", "what"),
    [
        (1, "the process ended with exit code 1"),
        (0xC0000005, "the process crashed with status 0xC0000005 (access violation)"),
        (0xC0000123, "the process crashed with status 0xC0000123 (an error of Windows)"),
        (-9, "the process was killed by SIGKILL"),
    ],
)
def test_crashes_are_named(code: int, what: str) -> None:
    assert process._describe_exit(code) == what  # pyright: ignore[reportPrivateUsage]
