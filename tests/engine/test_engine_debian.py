"""Debian packages, with a pretended apt; and the launcher script."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from ludus.engine import apt
from ludus.engine.debian import debian_engine
from ludus.engine.installing import InstallerUnavailable
from ludus.engine.kinds import EngineKind
from ludus.engine.prefix import find_program, write_launcher
from ludus.errors import SetupError

TARGETS = "Packages|Debian-Security|http://a/security\\nPackages|Debian|http://a/debian"


@pytest.fixture
def tools(bare_machine: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A pretended apt-get and dpkg-deb, and a keyring."""
    keyring = tmp_path / "keyring.gpg"
    keyring.touch()
    monkeypatch.setattr(apt, "_KEYRINGS", (str(keyring),))
    write_tool(bare_machine / "apt-get", f"printf '{TARGETS}\\n'")
    write_tool(bare_machine / "dpkg-deb", "exit 0")
    return bare_machine


def write_tool(path: Path, body: str) -> None:
    path.write_text(f"#!/bin/sh\n{body}\n")
    path.chmod(0o755)


def unpack(tmp_path: Path) -> None:
    folder = tmp_path / "into"
    folder.mkdir()
    installer = debian_engine(EngineKind.GODOT4, rendering=False)
    installer.unpack(folder, lambda _what, _fraction: None)


def test_without_apt_the_installer_is_unavailable(bare_machine: Path, tmp_path: Path) -> None:
    with pytest.raises(InstallerUnavailable, match="no apt-get"):
        unpack(tmp_path)


def test_without_keys_the_installer_is_unavailable(
    tools: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(apt, "_KEYRINGS", (str(tmp_path / "none"),))
    with pytest.raises(InstallerUnavailable, match="signing keys"):
        unpack(tmp_path)


def test_without_a_debian_mirror_the_installer_is_unavailable(tools: Path, tmp_path: Path) -> None:
    write_tool(tools / "apt-get", "echo 'Packages|Ubuntu|http://a/ubuntu'")
    with pytest.raises(InstallerUnavailable, match="no Debian mirror"):
        unpack(tmp_path)


def test_mirror_comes_from_the_machine(tools: Path, tmp_path: Path) -> None:
    configuration = apt._make_apt_tree(tmp_path / "apt")  # pyright: ignore[reportPrivateUsage]
    sources = (configuration.parent / "sources.list").read_text()
    assert sources == (
        f"deb [signed-by={tmp_path / 'keyring.gpg'} target=Packages] http://a/debian sid main\n"
    )


@pytest.mark.parametrize(
    ("message", "error"),
    [
        ("E: Failed to fetch x  Could not resolve", InstallerUnavailable),
        ("E: You don't have enough free space in /c.", SetupError),
    ],
)
def test_apt_errors_are_passed_on(
    tools: Path, tmp_path: Path, message: str, error: type[Exception]
) -> None:
    body = (
        f'case "$1" in indextargets) printf "{TARGETS}\\n";; *) echo "{message}"; exit 100;; esac'
    )
    write_tool(tools / "apt-get", body)
    with pytest.raises(error, match="apt-get update failed"):
        unpack(tmp_path)


def test_broken_package_is_an_error(tools: Path, tmp_path: Path) -> None:
    write_tool(tools / "dpkg-deb", "echo short read; exit 2")
    (tmp_path / "a.deb").touch()
    with pytest.raises(SetupError, match=r"a\.deb could not be unpacked: short read"):
        apt._unpack_all(  # pyright: ignore[reportPrivateUsage]
            [tmp_path / "a.deb"], tmp_path, lambda _what, _fraction: None
        )


@pytest.fixture
def prefix(tmp_path: Path) -> Path:
    """A prefix whose loader prints its arguments and its process id."""
    root = tmp_path / "first place" / "prefix"
    (root / "usr/lib64").mkdir(parents=True)
    (root / "usr/lib/x86_64-linux-gnu/dri").mkdir(parents=True)
    (root / "usr/bin").mkdir()
    (root / "usr/bin/godot").touch()
    write_tool(root / "usr/lib64/ld-linux-x86-64.so.2", 'echo $$ "[$LIBGL_ALWAYS_SOFTWARE]" "$@"')
    return root


def start(launcher: Path, *arguments: str) -> tuple[bool, str]:
    """Return whether the launcher kept its process id, and what the loader printed."""
    with subprocess.Popen([str(launcher), *arguments], stdout=subprocess.PIPE) as process:
        output = process.communicate(timeout=60)[0].decode()
    pid, _, rest = output.strip().partition(" ")
    return int(pid) == process.pid, rest


def test_launcher_can_be_moved_and_keeps_its_pid(prefix: Path, tmp_path: Path) -> None:
    launcher = prefix.parent / "godot"
    write_launcher(launcher, prefix, find_program(prefix, "godot"))
    moved = tmp_path / "second $place"
    shutil.move(prefix.parent, moved)
    (tmp_path / "link").symlink_to(moved / "godot")
    for program in (moved / "godot", tmp_path / "link"):
        kept_pid, output = start(program, "--path", "a b")
        assert kept_pid
        libraries = f"{moved}/prefix/usr/lib/x86_64-linux-gnu"
        assert output == (
            f"[] --library-path {libraries}:{libraries}/pulseaudio --argv0 godot "
            f"{moved}/prefix/usr/bin/godot --path a b"
        )


def test_launcher_names_the_drivers_of_the_prefix(prefix: Path) -> None:
    vendor = prefix / "usr/share/glvnd/egl_vendor.d/50_mesa.json"
    vendor.parent.mkdir(parents=True)
    vendor.touch()
    launcher = prefix.parent / "godot"
    write_launcher(launcher, prefix, prefix / "usr/bin/godot")
    assert start(launcher)[1].startswith("[1]")


def test_prefix_without_program_or_loader_is_an_error(prefix: Path) -> None:
    with pytest.raises(SetupError, match="not contain the program godot3"):
        find_program(prefix, "godot3")
    shutil.rmtree(prefix / "usr/lib64")
    with pytest.raises(SetupError, match="loader"):
        write_launcher(prefix.parent / "godot", prefix, prefix / "usr/bin/godot")
