"""Installing: all or nothing, once, and with clear reasons."""

from __future__ import annotations

import errno
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from engine_fakes import FakeInstaller, refuse, visible

from ludus.engine.find import find_engine
from ludus.engine.install import install_engine
from ludus.engine.kinds import EngineKind
from ludus.errors import EngineNotFound, SetupError

GODOT4 = EngineKind.GODOT4


@pytest.fixture
def engines(tmp_path: Path, bare_machine: Path) -> Path:
    return tmp_path / "cache" / "ludus" / "engines" / "godot4"


def test_installed_engine_is_found(engines: Path) -> None:
    seen: list[str] = []
    installed = install_engine(
        GODOT4, installers=[FakeInstaller()], progress=lambda what, _fraction: seen.append(what)
    )
    assert find_engine(GODOT4) == installed
    assert installed.path == engines / "4.6.3-fake" / "godot"
    assert installed.source == "cache (fake)"
    assert seen == ["unpack"]
    assert visible(engines) == ["4.6.3-fake"]


def test_present_engine_is_reused_unless_forced(engines: Path) -> None:
    installer = FakeInstaller()
    first = install_engine(GODOT4, installers=[installer])
    (first.path.parent / "old").touch()
    assert install_engine(GODOT4, installers=[installer]) == first
    assert len(installer.calls) == 1
    assert install_engine(GODOT4, installers=[installer], force=True) == first
    assert len(installer.calls) == 2
    assert not (first.path.parent / "old").exists()
    assert visible(engines) == ["4.6.3-fake"]


def test_rendering_is_an_installation_of_its_own(engines: Path) -> None:
    install_engine(GODOT4, installers=[FakeInstaller()])
    with_rendering = FakeInstaller(has_rendering=True)
    rendering = install_engine(GODOT4, installers=[with_rendering], rendering=True)
    assert visible(engines) == ["4.6.3-fake", "4.6.3-fake-rendering"]
    assert find_engine(GODOT4) == rendering == install_engine(GODOT4, installers=[])


def test_two_at_once_install_once(engines: Path) -> None:
    installer = FakeInstaller(act=lambda _folder: time.sleep(0.3))
    with ThreadPoolExecutor(2) as executor:
        jobs = [executor.submit(install_engine, GODOT4, installers=[installer]) for _ in range(2)]
        results = [job.result() for job in jobs]
    assert results[0] == results[1]
    assert len(installer.calls) == 1


def test_next_installer_is_tried_and_all_reasons_are_told(engines: Path) -> None:
    unavailable = FakeInstaller(act=refuse, name="first")
    assert (
        install_engine(GODOT4, installers=[unavailable, FakeInstaller()]).source == "cache (fake)"
    )
    with pytest.raises(SetupError) as caught:
        install_engine(GODOT4, installers=[unavailable, unavailable], force=True)
    assert caught.value.message.count("first: no network") == 2
    assert "LUDUS_GODOT" in caught.value.hint
    assert visible(engines) == ["4.6.3-fake"]


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EACCES])
def test_disk_errors_leave_nothing(engines: Path, code: int) -> None:
    def fail(_folder: Path) -> None:
        raise OSError(code, "disk")

    with pytest.raises(SetupError) as caught:
        install_engine(GODOT4, installers=[FakeInstaller(act=fail)])
    assert ("free" in caught.value.hint) == (code == errno.ENOSPC)
    assert visible(engines) == []


@pytest.mark.parametrize("version", ["nonsense", "3.6.2.stable"])
def test_engine_that_is_no_good_is_not_installed(engines: Path, version: str) -> None:
    with pytest.raises(SetupError):
        install_engine(GODOT4, installers=[FakeInstaller(version=version)])
    assert visible(engines) == []


KILLED_INSTALL = """
import sys, time
sys.path.insert(0, {tests!r})
from engine_fakes import FakeInstaller
from test_engine_install import GODOT4
from ludus.engine.install import install_engine

def hang(folder):
    print("half", flush=True)
    time.sleep(60)

install_engine(GODOT4, installers=[FakeInstaller(act=hang)])
"""


def test_killed_installation_is_not_taken_for_an_engine(engines: Path) -> None:
    script = KILLED_INSTALL.format(tests=str(Path(__file__).parent))
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"half\n"
        process.kill()
    assert len(visible(engines)) == 1
    with pytest.raises(EngineNotFound):
        find_engine(GODOT4)
    install_engine(GODOT4, installers=[FakeInstaller()])
    assert visible(engines) == ["4.6.3-fake"]


def test_without_platformdirs_the_hint_says_what_to_install(
    bare_machine: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "platformdirs", None)
    with pytest.raises(SetupError, match="pip install"):
        install_engine(GODOT4, installers=[FakeInstaller()])
