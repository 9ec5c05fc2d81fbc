"""Finding projects and scenes on disk."""

from __future__ import annotations

from pathlib import Path

import pytest

from ludus.engine.kinds import EngineKind
from ludus.engine.project import find_project, read_project, scene_path
from ludus.errors import TargetError


def write_project(root: Path, text: str) -> Path:
    root.mkdir(parents=True, exist_ok=True)
    (root / "project.godot").write_text(text)
    return root


def test_project_is_found_upwards(tiny_project: Path) -> None:
    inner = tiny_project / "a" / "b"
    inner.mkdir(parents=True)
    for start in (tiny_project, inner, tiny_project / "main.tscn", tiny_project / "project.godot"):
        assert find_project(start).root == tiny_project
    project = find_project(tiny_project)
    assert project.name == "Tiny"
    assert project.engine_kind is EngineKind.GODOT4
    assert project.main_scene == "res://main.tscn"
    assert project.ticks_per_second == 60


@pytest.mark.parametrize(
    ("text", "kind", "ticks"),
    [
        (
            "config_version=5\n[physics]\ncommon/physics_ticks_per_second=30",
            EngineKind.GODOT4,
            30,
        ),
        ("config_version=4\n[physics]\ncommon/physics_fps=120", EngineKind.GODOT3, 120),
        ("\ufeffconfig_version=4\n", EngineKind.GODOT3, 60),
    ],
)
def test_both_engines_are_read(tmp_path: Path, text: str, kind: EngineKind, ticks: int) -> None:
    project = read_project(write_project(tmp_path / "game", text))
    assert (project.engine_kind, project.ticks_per_second) == (kind, ticks)
    assert (project.name, project.main_scene) == ("game", None)


@pytest.mark.parametrize("text", ["", "config_version=3", "config_version=x"])
def test_other_versions_are_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(TargetError, match="config_version"):
        read_project(write_project(tmp_path, text))


def test_unreadable_project_is_refused(tmp_path: Path) -> None:
    (tmp_path / "project.godot").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(TargetError, match="cannot be read"):
        read_project(tmp_path)


def test_no_project_is_an_error_with_the_place(tmp_path: Path) -> None:
    with pytest.raises(TargetError, match=str(tmp_path)) as caught:
        find_project(tmp_path)
    assert caught.value.hint


def test_scenes_are_named_in_many_ways(tiny_project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    project = find_project(tiny_project)
    inner = tiny_project / "levels"
    inner.mkdir()
    (inner / "one.tscn").write_text('[gd_scene format=3 uid="uid://one"]\n')
    monkeypatch.chdir(inner)
    assert scene_path(project, None) == "res://main.tscn"
    for scene in (
        "res://levels/one.tscn",
        "levels/one.tscn",
        "one.tscn",
        inner / "one.tscn",
        "uid://one",
    ):
        assert scene_path(project, scene) == "res://levels/one.tscn"


def test_wrong_scenes_are_refused_with_a_list(tiny_project: Path, tmp_path: Path) -> None:
    project = find_project(tiny_project)
    (tmp_path / "outside.tscn").touch()
    (tiny_project / ".godot").mkdir()
    (tiny_project / ".godot" / "hidden.tscn").touch()
    cases = {
        "res://gone.tscn": "no scene",
        "res://../outside.tscn": "outside",
        str(tmp_path / "outside.tscn"): "outside",
        "uid://gone": "uid://gone",
        "main.gd": "is not a scene",
    }
    for scene, text in cases.items():
        with pytest.raises(TargetError, match=text) as caught:
            scene_path(project, scene)
        if text != "outside":
            assert caught.value.hint == "scenes of this project: main.tscn"


def test_project_without_main_scene_needs_one_named(tmp_path: Path) -> None:
    project = read_project(write_project(tmp_path, "config_version=5"))
    with pytest.raises(TargetError, match="no main scene"):
        scene_path(project, None)
