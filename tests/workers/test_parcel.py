"""Games on their way to other machines: known by their content, kept once."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from ludus.target import Scene, parse_target
from ludus.workers import parcel as parcels
from ludus.workers.parcel import Parcel, find_parcel, has_parcel, unpack_parcel
from tests.godot_project import write_project


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(parcels, "require_cache_root", lambda: tmp_path / "cache")
    return tmp_path / "cache"


def found(target: Path) -> Parcel:
    one = find_parcel(str(target), None, None)
    assert one is not None
    return one


@pytest.fixture
def program(tmp_path: Path) -> Path:
    """An exported game as Godot leaves it, in a folder with other things."""
    folder = tmp_path / "exported"
    (folder / "data_game_linux").mkdir(parents=True)
    (folder / "data_game_linux" / "game.dll").write_bytes(b"code")
    (folder / "game.pck").write_bytes(b"scenes")
    (folder / "libextension.so").write_bytes(b"native")
    (folder / "holiday.jpg").write_bytes(b"private")
    path = folder / "game.x86_64"
    path.write_bytes(b"#!/bin/sh\n")
    path.chmod(0o755)
    return path


def test_a_program_goes_with_what_it_needs_and_nothing_else(program: Path, cache: Path) -> None:
    one = found(program)
    assert one.paths == ("data_game_linux/game.dll", "game.pck", "game.x86_64", "libextension.so")
    assert not has_parcel(one.digest)
    unpack_parcel(one.digest, one.read())
    assert has_parcel(one.digest)
    place = Path(one.settings()["target"])
    assert place == cache / "games" / one.digest / "game.x86_64"
    assert os.access(place, os.X_OK)
    assert not os.access(place.with_name("game.pck"), os.X_OK)
    unpack_parcel(one.digest, one.read())  # another run was quicker
    assert [path.name for path in (cache / "games").iterdir()] == [one.digest]


def test_what_changes_is_another_game(program: Path) -> None:
    first = found(program).digest
    assert found(program).digest == first
    program.with_name("game.pck").write_bytes(b"another scene")
    second = found(program).digest
    program.with_name("game.pck").write_bytes(b"scenes")
    assert second != first == found(program).digest
    program.with_name("game.pck").rename(program.with_name("game.zip"))
    assert found(program).digest != first


def test_games_that_were_not_used_for_long_are_forgotten(program: Path, cache: Path) -> None:
    one = found(program)
    unpack_parcel(one.digest, one.read())
    os.utime(cache / "games" / one.digest, (0, 0))
    program.write_bytes(b"#!/bin/bash\n")
    two = found(program)
    unpack_parcel(two.digest, two.read())
    assert [path.name for path in (cache / "games").iterdir()] == [two.digest]


def test_a_project_goes_without_what_godot_makes_of_it(tmp_path: Path, cache: Path) -> None:
    files = {"game.gd": "extends LudusAgent\n", "game.tscn": "[gd_scene format=3]\n"}
    project = write_project(tmp_path / "project", files, main="game")
    for name in (".godot", ".git"):
        (project / name).mkdir()
        (project / name / "file").write_text("")
    one = found(project)
    assert "game.gd" in one.paths
    assert not any(path.startswith((".godot", ".git/")) for path in one.paths)
    unpack_parcel(one.digest, one.read())
    settings = one.settings()
    sent = parse_target(settings["target"], scene=settings["scene"])
    own = parse_target(str(project))
    assert isinstance(sent, Scene)
    assert isinstance(own, Scene)
    assert sent.path == own.path
    assert sent.project.name == own.project.name


@pytest.mark.parametrize("target", ["cartpole", "gym:CartPole-v1", "localhost:1,localhost:2"])
def test_what_is_everywhere_is_not_sent(target: str) -> None:
    assert find_parcel(target, None, None) is None
