"""Importing a project: when it is needed, and what can go wrong."""

from __future__ import annotations

import contextlib
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest

from ludus.engine.find import InstalledEngine
from ludus.engine.importing import STAMP_NAME, ensure_imported, needs_import
from ludus.engine.kinds import EngineKind
from ludus.engine.launch import GodotFlags, LaunchConfig, godot_command
from ludus.engine.process import EngineProcess
from ludus.engine.project import find_project
from ludus.errors import EngineStartError, EngineTimeout, SetupError


@pytest.fixture
def counting_engine(tmp_path: Path) -> InstalledEngine:
    """An engine that notes every start in a file, and imports nothing."""
    program = tmp_path / "counting"
    program.write_text(f"#!/bin/sh\nsleep 0.2\necho \"$@\" >> '{tmp_path}/starts'\n")
    program.chmod(0o755)
    return InstalledEngine(EngineKind.GODOT4, program, (4, 6), "4.6.fake", "test")


def broken_engine(engine: InstalledEngine, body: str) -> InstalledEngine:
    engine.path.write_text(f"#!/bin/sh\n{body}\n")
    return engine


@pytest.mark.slow
def test_every_kind_of_change_is_noticed(
    counting_engine: InstalledEngine, tiny_project: Path
) -> None:
    project = find_project(tiny_project)
    assert ensure_imported(counting_engine, project)
    assert not ensure_imported(counting_engine, project)
    script = tiny_project / "thing.gd"

    def touch() -> None:
        os.utime(script, ns=(1, 1))

    changes = [
        touch,
        lambda: script.write_text("class_name TinyThing\n"),
        (tiny_project / "new.gd").touch,
        lambda: (tiny_project / "new.gd").rename(tiny_project / "other.gd"),
        (tiny_project / "other.gd").unlink,
        (tiny_project / ".godot" / STAMP_NAME).unlink,
    ]
    for change in changes:
        change()
        assert ensure_imported(counting_engine, project)
        assert not needs_import(counting_engine, project)
    assert needs_import(replace(counting_engine, version_text="4.7.fake"), project)


def test_what_godot_ignores_is_ignored(
    counting_engine: InstalledEngine, tiny_project: Path
) -> None:
    project = find_project(tiny_project)
    for name in ("raw", ".git"):
        (tiny_project / name).mkdir()
    (tiny_project / "raw" / ".gdignore").touch()
    (tiny_project / "loop").symlink_to(tiny_project)
    (tiny_project / "dangling").symlink_to(tiny_project / "nothing")
    ensure_imported(counting_engine, project)
    (tiny_project / "raw" / "x.png").touch()
    (tiny_project / ".git" / "HEAD").touch()
    assert not needs_import(counting_engine, project)


def test_change_during_an_import_is_not_lost(
    counting_engine: InstalledEngine, tiny_project: Path
) -> None:
    engine = broken_engine(counting_engine, f"echo x >> '{tiny_project}/thing.gd'")
    assert ensure_imported(engine, find_project(tiny_project))
    assert needs_import(engine, find_project(tiny_project))


@pytest.mark.parametrize("change", ["touch '{}/new.gd'", "exit 3"], ids=["changed", "failed"])
def test_an_import_that_is_worth_nothing_is_repeated(
    change: str, counting_engine: InstalledEngine, tiny_project: Path
) -> None:
    """Its class list may name scripts that are gone, though the files are those of the first."""
    project = find_project(tiny_project)
    ensure_imported(counting_engine, project)
    (tiny_project / "gone.gd").touch()
    engine = broken_engine(counting_engine, change.format(tiny_project))
    with contextlib.suppress(EngineStartError):
        ensure_imported(engine, project)
    for name in ("gone.gd", "new.gd"):
        (tiny_project / name).unlink(missing_ok=True)
    assert needs_import(engine, project)


def test_generated_files_count_by_content(
    counting_engine: InstalledEngine, tiny_project: Path
) -> None:
    """Another project with a link to the same add-on writes them, too."""
    project, generated = find_project(tiny_project), tiny_project / "icon.svg.import"
    generated.write_text("mode=0")
    ensure_imported(counting_engine, project)
    os.utime(generated, ns=(1, 1))
    assert not needs_import(counting_engine, project)
    generated.write_text("mode=1")
    assert needs_import(counting_engine, project)


def test_two_at_once_import_once(
    counting_engine: InstalledEngine, tiny_project: Path, tmp_path: Path
) -> None:
    project = find_project(tiny_project)
    with ThreadPoolExecutor(2) as executor:
        jobs = [executor.submit(ensure_imported, counting_engine, project) for _ in range(2)]
        results = [job.result() for job in jobs]
    assert sorted(results) == [False, True]
    starts = (tmp_path / "starts").read_text().splitlines()
    assert starts == [f"--headless --import --path {tiny_project}"]


def test_failed_import_shows_the_log(counting_engine: InstalledEngine, tiny_project: Path) -> None:
    engine = broken_engine(counting_engine, "echo 'ERROR: no memory'; exit 3")
    with pytest.raises(EngineStartError, match=r"(?s)exit code 3.*! ERROR: no memory"):
        ensure_imported(engine, find_project(tiny_project))
    assert needs_import(engine, find_project(tiny_project))


@pytest.mark.slow
def test_hanging_import_ends(counting_engine: InstalledEngine, tiny_project: Path) -> None:
    engine = broken_engine(counting_engine, "echo started; sleep 60")
    with pytest.raises(EngineTimeout, match=r"(?s)within 2 s.*\| started"):
        ensure_imported(engine, find_project(tiny_project), timeout_s=2.0)


def test_project_that_cannot_be_written_is_reported(
    counting_engine: InstalledEngine, tiny_project: Path
) -> None:
    (tiny_project / ".godot").write_text("a file where the folder should be")
    with pytest.raises(SetupError, match="cannot be imported"):
        ensure_imported(counting_engine, find_project(tiny_project))


def test_godot3_imports_nothing(counting_engine: InstalledEngine, tiny_project: Path) -> None:
    engine = replace(counting_engine, kind=EngineKind.GODOT3)
    assert not ensure_imported(engine, find_project(tiny_project))


@pytest.mark.engine
def test_real_import_makes_a_fresh_project_run(godot4: InstalledEngine, tiny_project: Path) -> None:
    project = find_project(tiny_project)
    assert ensure_imported(godot4, project)
    assert (tiny_project / ".godot" / "global_script_class_cache.cfg").is_file()
    assert not ensure_imported(godot4, project)
    flags = GodotFlags(user_args=("--ludus-x=1",), engine_args=("--quit-after", "2"))
    command = godot_command(godot4, tiny_project, "res://main.tscn", flags)
    with EngineProcess.start(LaunchConfig(command=command)) as process:
        assert process.wait(30) == 0, process.describe_death()
        process.describe_death()
        lines = process.last_lines()
    assert 'args ["--ludus-x=1"]' in lines
    assert "tiny 7" in lines
    assert not needs_import(godot4, project)  # running changed nothing
