"""Working out what the user asks to run."""

from __future__ import annotations

from pathlib import Path

import pytest
from engine_fakes import fake_godot

from ludus.engine import bundled
from ludus.engine.kinds import EngineKind
from ludus.engine.target import TargetKind, resolve_target
from ludus.errors import ConfigError, EngineNotFound, SetupError, TargetError


@pytest.fixture
def examples(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A checkout with two examples; returns its Godot project."""
    root = tmp_path / "checkout" / "engines" / "godot4"
    (root / "addons" / "ludus").mkdir(parents=True)
    (root / "project.godot").write_text("config_version=5\n")
    for name in ("cartpole", "pendulum"):
        (root / "examples" / name).mkdir(parents=True)
        (root / "examples" / name / f"{name}.tscn").write_text("[gd_scene format=3]\n")
        (root / "examples" / name / "other.tscn").write_text("[gd_scene format=3]\n")
    package = tmp_path / "checkout" / "src" / "ludus"
    monkeypatch.setattr(bundled, "_package_folder", lambda: package)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return root


def test_example_by_name(examples: Path) -> None:
    target = resolve_target("cartpole")
    assert target.kind is TargetKind.EXAMPLE
    assert target.project is not None
    assert target.project.root == examples
    assert target.scene == "res://examples/cartpole/cartpole.tscn"
    assert target.engine_kind is EngineKind.GODOT4
    assert target.is_started_by_us
    other = resolve_target("cartpole", scene="res://examples/cartpole/other.tscn")
    assert other.scene == "res://examples/cartpole/other.tscn"


def test_example_of_a_wheel_is_copied_once_to_a_writable_place(
    examples: Path, tmp_path: Path
) -> None:
    wheel = tmp_path / "checkout" / "src" / "ludus" / "_bundled" / "godot4"
    wheel.parent.mkdir(parents=True)
    examples.rename(wheel)
    (wheel / ".godot").mkdir()
    wheel.chmod(0o555)
    target = resolve_target("pendulum")
    copy = tmp_path / "cache" / "ludus" / "bundled" / "godot4" / bundled.package_version()
    assert target.project is not None
    assert target.project.root == copy
    assert not (copy / ".godot").exists()
    (copy / "mark").touch()
    resolve_target("cartpole")
    assert (copy / "mark").exists()
    assert sorted(entry.name for entry in copy.parent.iterdir()) == [".copy.lock", copy.name]


def test_unknown_name_lists_what_is_close(examples: Path) -> None:
    with pytest.raises(TargetError, match=r"'cartpol'; close: cartpole") as caught:
        resolve_target("cartpol")
    assert "cartpole, pendulum" in caught.value.hint


def test_without_examples_the_error_still_helps(examples: Path) -> None:
    examples.rename(examples.with_name("gone"))
    with pytest.raises(TargetError) as caught:
        resolve_target("cartpole")
    assert "(none)" in caught.value.hint
    with pytest.raises(SetupError, match="lacks its Godot project"):
        bundled.bundled_root()


def test_project_and_scene_on_disk(tiny_project: Path, examples: Path) -> None:
    for target in (
        resolve_target(tiny_project),
        resolve_target(str(tiny_project / "project.godot")),
        resolve_target(tiny_project / "main.tscn"),
        resolve_target(tiny_project, scene="main.tscn"),
    ):
        assert (target.kind, target.name) == (TargetKind.PROJECT, "main")
        assert target.scene == "res://main.tscn"
        assert target.project is not None
        assert target.project.root == tiny_project


def test_bare_word_is_an_example_and_a_path_is_a_path(
    tiny_project: Path, examples: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tiny_project.rename(tiny_project.with_name("cartpole"))
    monkeypatch.chdir(tiny_project.parent)
    assert resolve_target("cartpole").kind is TargetKind.EXAMPLE
    assert resolve_target("./cartpole").kind is TargetKind.PROJECT


def test_exported_game(tmp_path: Path, examples: Path) -> None:
    game = tmp_path / "game.x86_64"
    game.touch(mode=0o755)
    target = resolve_target(game)
    assert (target.kind, target.executable) == (TargetKind.EXECUTABLE, game)
    assert target.engine_kind is None
    assert target.find_engine() is None
    game.chmod(0o644)
    with pytest.raises(TargetError, match="neither a scene"):
        resolve_target(game)


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("localhost:11011", ("localhost", 11011)),
        ("10.0.0.7:1", ("10.0.0.7", 1)),
        ("[::1]:65535", ("::1", 65535)),
    ],
)
def test_addresses(text: str, address: tuple[str, int], examples: Path) -> None:
    target = resolve_target(text)
    assert (target.kind, target.address) == (TargetKind.ADDRESS, address)
    assert not target.is_started_by_us


@pytest.mark.parametrize("text", ["localhost:0", "localhost:70000", "localhost:", ":1", "a b:1"])
def test_bad_addresses(text: str, examples: Path) -> None:
    with pytest.raises(TargetError):
        resolve_target(text)


def test_play_listens_here(examples: Path) -> None:
    target = resolve_target("play")
    assert (target.kind, target.address) == (TargetKind.PLAY, ("127.0.0.1", 11011))
    assert not target.is_started_by_us


@pytest.mark.parametrize("text", ["play", "localhost:1"])
def test_scene_is_refused_where_it_has_no_effect(text: str, examples: Path) -> None:
    with pytest.raises(TargetError, match="decides itself"):
        resolve_target(text, scene="res://main.tscn")


def test_folder_without_project_is_refused(tmp_path: Path, examples: Path) -> None:
    with pytest.raises(TargetError, match=r"no project\.godot"):
        resolve_target(tmp_path)


def test_engine_is_found_for_the_project(
    tiny_project: Path, examples: Path, bare_machine: Path
) -> None:
    with pytest.raises(EngineNotFound):
        resolve_target(tiny_project).find_engine()
    program = fake_godot(bare_machine.parent / "mine", "4.6.stable")
    engine = resolve_target(tiny_project, godot=program).find_engine()
    assert engine is not None
    assert engine.path == program
    with pytest.raises(ConfigError):
        resolve_target(tiny_project, godot="/nowhere").find_engine()
