"""Virtual screens: which Xvfb is taken, how long it lasts, and how one gets into the cache."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from engine_fakes import fake_godot

from ludus.cli.main import main
from ludus.engine import install_screen, with_display
from ludus.engine.prefix import replace_path
from ludus.errors import SetupError

FAKE = """\
#!/bin/sh
echo "$*" > "$ARGUMENTS"
echo 7 >&3
exec sleep 60
"""


def write_xvfb(path: Path, text: str = FAKE) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    path.chmod(0o755)
    return path


@pytest.fixture
def screenless(bare_machine: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A machine with neither a screen nor an engine; returns the folder that is its PATH."""
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    return bare_machine


def test_a_real_screen_is_used(screenless: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DISPLAY", ":0")
    assert with_display(("godot",)) == ("godot",)


def test_xvfb_on_path_goes_before_the_one_in_the_cache(screenless: Path, tmp_path: Path) -> None:
    with pytest.raises(SetupError, match="neither one nor Xvfb") as caught:
        with_display(("godot",))
    assert "ludus engine install godot4 --rendering" in caught.value.hint
    assert "apt install xvfb" in caught.value.hint
    cached = write_xvfb(tmp_path / "cache/ludus/screens/xvfb-debian/Xvfb")
    assert str(cached) in with_display(("godot",))
    on_path = write_xvfb(screenless / "Xvfb")
    assert str(on_path) in with_display(("godot",))
    assert install_screen() == on_path


def test_a_screen_lasts_as_long_as_the_command(
    screenless: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setenv("TMPDIR", str(temporary))
    monkeypatch.setenv("ARGUMENTS", str(tmp_path / "arguments"))
    write_xvfb(screenless / "Xvfb")
    script = 'echo "$DISPLAY"; head -c 4 "$XAUTHORITY" | wc -c; exit 5'
    command = with_display(("sh", "-c", script))
    monkeypatch.undo()
    environment = {"TMPDIR": str(temporary), "ARGUMENTS": str(tmp_path / "arguments")}
    done = run(command, environment)
    assert (done.stdout.split(), done.returncode) == ([":7", "4"], 5)
    assert list(temporary.iterdir()) == []
    assert f"-nolisten tcp -auth {temporary}" in (tmp_path / "arguments").read_text()


def test_an_xvfb_that_does_not_start_says_why(screenless: Path, tmp_path: Path) -> None:
    write_xvfb(screenless / "Xvfb", "#!/bin/sh\necho no fonts\n")
    done = run(with_display(("sh", "-c", "echo played")), {"TMPDIR": str(tmp_path)})
    assert done.returncode == 1
    assert done.stdout.split("\n")[0] == "no fonts"
    assert "does not start" in done.stdout
    assert "played" not in done.stdout


def run(command: tuple[str, ...], environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    environment["PATH"] = "/usr/bin:/bin"
    return subprocess.run(
        command, stdout=subprocess.PIPE, text=True, env=environment, timeout=60, check=False
    )


def test_without_apt_the_command_to_run_is_named(screenless: Path) -> None:
    with pytest.raises(SetupError, match="no apt-get") as caught:
        install_screen()
    assert "apt install xvfb" in caught.value.hint


def test_an_engine_without_a_screen_is_still_installed(
    screenless: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "cache/ludus/engines/godot4/4.6.3-official"
    fake_godot(folder / "godot", "4.6.3.stable")
    (folder / "engine.json").write_text(RECORD)
    assert main(["engine", "install", "godot4", "--rendering"]) == 0
    printed = capsys.readouterr()
    assert "godot4 4.6.3.stable" in printed.out
    assert "warning: Xvfb could not be installed" in printed.err
    assert "apt install xvfb" in printed.err


RECORD = """{"version": [4, 6, 3], "version_text": "4.6.3.stable", "route": "official",
"has_rendering": true, "executable": "godot", "window_executable": "godot"}"""


def test_only_a_path_that_occurs_once_is_replaced(tmp_path: Path) -> None:
    program = tmp_path / "program"
    program.write_bytes(b"a\0/usr/bin\0b /usr/bin/c\0")
    replace_path(program, "/usr/bin", ".")
    assert program.read_bytes() == b"a\0.\0\0\0\0\0\0\0\0b /usr/bin/c\0"
    with pytest.raises(SetupError, match="0 times"):
        replace_path(program, "/usr/bin", ".")
