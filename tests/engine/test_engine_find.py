"""Finding engines: the order of places, and what is refused."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from engine_fakes import fake_godot

from ludus.engine import version as version_module
from ludus.engine.cache import EngineRecord
from ludus.engine.find import InstalledEngine, find_engine, list_engines
from ludus.engine.kinds import EngineKind
from ludus.engine.version import parse_version
from ludus.errors import ConfigError, EngineNotFound

GODOT4 = EngineKind.GODOT4


def put_in_cache(tmp_path: Path, version: str, name: str) -> Path:
    folder = tmp_path / "cache" / "ludus" / "engines" / "godot4" / name
    program = fake_godot(folder / "godot", f"{version}.stable")
    numbers = tuple(int(part) for part in version.split("."))
    record = EngineRecord(
        version=numbers,
        version_text=f"{version}.stable",
        route="debian",
        has_rendering=False,
        executable="godot",
        window_executable="godot",
    )
    record.write(folder)
    return program


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("4.6.3.stable.official.abc\n", ((4, 6, 3), "4.6.3.stable.official.abc")),
        ("4.6.stable.debian4.6+ds-3", ((4, 6), "4.6.stable.debian4.6+ds-3")),
        ("WARNING: no display\n3.6.2.stable.debian", ((3, 6, 2), "3.6.2.stable.debian")),
        ("Python 3.11.2", None),
        ("", None),
    ],
)
def test_versions_are_read(text: str, expected: object) -> None:
    assert parse_version(text) == expected


def test_places_are_asked_in_order(
    tmp_path: Path, bare_machine: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cached = put_in_cache(tmp_path, "4.5.0", "old")
    assert find_engine(GODOT4).path == cached
    on_path = fake_godot(bare_machine / "godot", "4.4.stable")
    assert (find_engine(GODOT4).path, find_engine(GODOT4).source) == (on_path, "PATH")
    better_name = fake_godot(bare_machine / "godot4", "4.4.stable")
    assert find_engine(GODOT4).path == better_name
    named = fake_godot(tmp_path / "mine", "4.4.1.stable")
    monkeypatch.setenv("LUDUS_GODOT", str(named))
    assert (find_engine(GODOT4).path, find_engine(GODOT4).source) == (named, "$LUDUS_GODOT")
    given = fake_godot(tmp_path / "given", "4.7.stable")
    assert find_engine(GODOT4, given) == InstalledEngine(
        GODOT4, given, (4, 7), "4.7.stable", "--godot"
    )
    assert [engine.path for engine in list_engines()] == [named, better_name, on_path, cached]


def test_newest_in_the_cache_wins(tmp_path: Path, bare_machine: Path) -> None:
    put_in_cache(tmp_path, "4.5.0", "b")
    newest = put_in_cache(tmp_path, "4.10.0", "a")
    assert find_engine(GODOT4).path == newest


def test_broken_cache_entries_are_ignored(tmp_path: Path, bare_machine: Path) -> None:
    good = put_in_cache(tmp_path, "4.5.0", "good")
    for name, text in [("a", "{"), ("b", "[]"), ("c", '{"version": [9]}')]:
        folder = good.parent.parent / name
        fake_godot(folder / "godot", "9.0.stable")
        (folder / "engine.json").write_text(text)
    put_in_cache(tmp_path, "9.9.9", "gone").unlink()
    assert find_engine(GODOT4).path == good


@pytest.mark.parametrize("source", ["--godot", "$LUDUS_GODOT"])
@pytest.mark.parametrize("fault", ["missing", "not executable", "3.6.2.stable", "4.3.stable", "no"])
def test_named_engine_is_used_or_refused(
    source: str,
    fault: str,
    tmp_path: Path,
    bare_machine: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fake_godot(bare_machine / "godot4", "4.6.stable")
    path = tmp_path / "named"
    if fault != "missing":
        fake_godot(path, fault)
    if fault == "not executable":
        path.chmod(0o644)
    if source == "$LUDUS_GODOT":
        monkeypatch.setenv("LUDUS_GODOT", str(path))
    with pytest.raises(ConfigError) as caught:
        find_engine(GODOT4, path if source == "--godot" else None)
    assert source in caught.value.message
    assert str(path) in caught.value.message


def test_not_found_lists_what_was_seen(bare_machine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fake_godot(bare_machine / "godot", "3.2.3.stable")
    fake_godot(bare_machine / "godot4", "hello")
    with pytest.raises(EngineNotFound) as caught:
        find_engine(GODOT4)
    text = str(caught.value)
    assert "3.2.3.stable; Godot 4 needs 4.4 or newer" in text
    assert f"{bare_machine / 'godot4'} does not answer" in text
    assert "$LUDUS_GODOT: not set" in text
    assert "hint: ludus engine install godot4" in text


def test_hanging_executable_is_passed_over(
    tmp_path: Path, bare_machine: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(version_module, "VERSION_TIMEOUT_S", 0.3)
    (bare_machine / "godot4").write_text("#!/bin/sh\nexec /bin/sleep 60\n")
    (bare_machine / "godot4").chmod(0o755)
    other = put_in_cache(tmp_path, "4.4.0", "other")  # whose version the cache knows
    assert find_engine(GODOT4).path == other


def test_without_platformdirs_the_cache_is_skipped(
    tmp_path: Path, bare_machine: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    put_in_cache(tmp_path, "4.5.0", "one")
    monkeypatch.setitem(sys.modules, "platformdirs", None)
    with pytest.raises(EngineNotFound, match="platformdirs is not installed"):
        find_engine(GODOT4)


def test_kinds_have_their_own_names(bare_machine: Path) -> None:
    program = fake_godot(bare_machine / "godot", "3.6.2.stable")
    assert find_engine(EngineKind.GODOT3).path == program
    with pytest.raises(EngineNotFound):
        find_engine(GODOT4)


@pytest.mark.engine
def test_real_engine_is_found(godot4: InstalledEngine) -> None:
    assert godot4.version >= (4, 4)
    assert find_engine(GODOT4, godot4.path).version_text == godot4.version_text
