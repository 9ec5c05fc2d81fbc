"""Working out what the user asks to run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import get_args

import pytest
from engine_fakes import fake_godot

from ludus.engine import bundled
from ludus.engine.kinds import EngineKind
from ludus.errors import ConfigError, EngineNotFound, SetupError, TargetError
from ludus.target import (
    COMMANDS,
    REFUSALS,
    Address,
    CargoPackage,
    Example,
    Executable,
    Gymnasium,
    Legacy,
    Play,
    PolicyFile,
    Run,
    Scene,
    Target,
    check_accepted,
    parse_target,
    prepare,
)


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
    assert parse_target("cartpole") == Example("cartpole")
    scene = prepare(parse_target("cartpole"))
    assert isinstance(scene, Scene)
    assert scene.project.root == examples
    assert scene.path == "res://examples/cartpole/cartpole.tscn"
    assert scene.project.engine_kind is EngineKind.GODOT4
    other = prepare(parse_target("cartpole", scene="res://examples/cartpole/other.tscn"))
    assert isinstance(other, Scene)
    assert other.path == "res://examples/cartpole/other.tscn"


def test_example_of_a_wheel_is_copied_once_to_a_writable_place(
    examples: Path, tmp_path: Path
) -> None:
    wheel = tmp_path / "checkout" / "src" / "ludus" / "_bundled" / "godot4"
    wheel.parent.mkdir(parents=True)
    examples.rename(wheel)
    (wheel / ".godot").mkdir()
    wheel.chmod(0o555)
    copy = tmp_path / "cache" / "ludus" / "bundled" / "godot4" / bundled.package_version()
    target = parse_target("pendulum")
    assert not copy.exists()
    scene = prepare(target)
    assert isinstance(scene, Scene)
    assert scene.project.root == copy
    assert not (copy / ".godot").exists()
    (copy / "mark").touch()
    prepare(parse_target("cartpole"))
    assert (copy / "mark").exists()
    assert sorted(entry.name for entry in copy.parent.iterdir()) == [".copy.lock", copy.name]


def test_unknown_name_lists_what_is_close(examples: Path) -> None:
    with pytest.raises(TargetError, match=r"'cartpol'; close: cartpole") as caught:
        parse_target("cartpol")
    assert "cartpole, pendulum" in caught.value.hint


def test_without_examples_the_error_still_helps(examples: Path) -> None:
    examples.rename(examples.with_name("gone"))
    with pytest.raises(TargetError) as caught:
        parse_target("cartpole")
    assert "(none)" in caught.value.hint
    with pytest.raises(SetupError, match="lacks its Godot project"):
        bundled.bundled_root()


def test_project_and_scene_on_disk(tiny_project: Path, examples: Path) -> None:
    for target in (
        parse_target(tiny_project),
        parse_target(str(tiny_project / "project.godot")),
        parse_target(tiny_project / "main.tscn"),
        parse_target(tiny_project, scene="main.tscn"),
    ):
        assert isinstance(target, Scene)
        assert (target.name, target.path) == ("main", "res://main.tscn")
        assert target.project.root == tiny_project


def test_bare_word_is_an_example_and_a_path_is_a_path(
    tiny_project: Path, examples: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tiny_project.rename(tiny_project.with_name("cartpole"))
    monkeypatch.chdir(tiny_project.parent)
    assert isinstance(parse_target("cartpole"), Example)
    assert isinstance(parse_target("./cartpole"), Scene)


def test_exported_game(tmp_path: Path, examples: Path) -> None:
    game = tmp_path / "game.x86_64"
    game.touch(mode=0o755)
    assert parse_target(game) == Executable(game)
    game.chmod(0o644)
    with pytest.raises(TargetError, match="neither a scene"):
        parse_target(game)


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("localhost:11011", Address("localhost", 11011)),
        ("10.0.0.7:1", Address("10.0.0.7", 1)),
        ("[::1]:65535", Address("::1", 65535)),
    ],
)
def test_addresses(text: str, address: Address, examples: Path) -> None:
    target = parse_target(text)
    assert target == address
    assert target.name == text


@pytest.mark.parametrize("text", ["localhost:0", "localhost:70000", "localhost:", ":1", "a b:1"])
def test_bad_addresses(text: str, examples: Path) -> None:
    with pytest.raises(TargetError):
        parse_target(text)


@pytest.mark.parametrize(
    ("text", "target"),
    [
        ("play", Play("127.0.0.1", 11011)),
        ("gym:CartPole-v1", Gymnasium("CartPole-v1")),
        ("gym:my_games:Mine-v0", Gymnasium("my_games:Mine-v0")),
        ("gymgodot:some/project", Legacy("gymgodot:some/project")),
        ("godot_gym_api:127.0.0.1:0", Legacy("godot_gym_api:127.0.0.1:0")),
        ("http://127.0.0.1:7878", Legacy("http://127.0.0.1:7878")),
    ],
)
def test_words(text: str, target: Target, examples: Path) -> None:
    assert parse_target(text) == target
    assert target.name == text


def test_runs_and_policy_files(tmp_path: Path, examples: Path) -> None:
    run = tmp_path / "runs" / "r"
    checkpoint = run / "checkpoints" / "step-1"
    checkpoint.mkdir(parents=True)
    (run / "config.json").touch()
    assert parse_target(run) == Run(run, run)
    assert parse_target(checkpoint) == Run(checkpoint, run)
    policy = tmp_path / "hero.ludus.json"
    policy.touch()
    assert parse_target(policy) == PolicyFile(policy)
    (run / "project.godot").write_text('config_version=5\n[application]\nrun/main_scene="m"\n')
    with pytest.raises(TargetError, match="scene"):  # a project, whatever else is in its folder
        parse_target(run)


@pytest.mark.parametrize("text", ["play", "localhost:1", "gym:CartPole-v1"])
def test_scene_is_refused_where_it_has_no_effect(text: str, examples: Path) -> None:
    with pytest.raises(TargetError, match="decides itself"):
        parse_target(text, scene="res://main.tscn")


def test_folder_without_project_is_refused(tmp_path: Path, examples: Path) -> None:
    with pytest.raises(TargetError, match=r"no project\.godot"):
        parse_target(tmp_path)


def test_engine_is_found_for_the_project(
    tiny_project: Path, examples: Path, bare_machine: Path
) -> None:
    scene = parse_target(tiny_project)
    assert isinstance(scene, Scene)
    with pytest.raises(EngineNotFound):
        scene.find_engine()
    program = fake_godot(bare_machine.parent / "mine", "4.6.stable")
    assert replace(scene, godot=program).find_engine().path == program
    with pytest.raises(ConfigError):
        replace(scene, godot=Path("/nowhere")).find_engine()


def test_a_folder_with_a_manifest_is_a_package(tmp_path: Path) -> None:
    (tmp_path / "Cargo.toml").write_text("")
    package = parse_target(tmp_path)
    assert package == CargoPackage(tmp_path)
    assert package.name == tmp_path.name
    with pytest.raises(TargetError, match="decides itself"):
        parse_target(tmp_path, scene="level.tscn")
    (tmp_path / "project.godot").write_text("config_version=5\n")
    with pytest.raises(TargetError, match="scene"):
        parse_target(tmp_path)  # a Godot project with Rust in it: it has no main scene


def test_every_kind_has_its_refusals() -> None:
    assert set(REFUSALS) == set(get_args(Target))
    named = {
        command for refusals in REFUSALS.values() for names, _ in refusals for command in names
    }
    assert named <= set(COMMANDS)


def test_the_page_shows_what_each_command_accepts() -> None:
    page = (Path(__file__).parents[2] / "docs" / "targets.md").read_text("utf-8")
    rows = [[cell.strip(" `") for cell in line.strip("|").split("|")]
            for line in page.splitlines() if line.startswith("|")]  # fmt: skip
    table = rows[rows.index(["", *COMMANDS]) + 2 :]
    assert {kind: marks for kind, *marks in table} == {
        kind.__name__: ["no" if refuses(command, kind) else "yes" for command in COMMANDS]
        for kind in REFUSALS
    }


def refuses(command: str, kind: type[Target]) -> bool:
    return any(command in commands for commands, _ in REFUSALS[kind])


def test_a_refusal_names_command_and_target() -> None:
    with pytest.raises(TargetError, match="runs/r is a run, and train needs a game") as caught:
        check_accepted("train", Run(Path("runs/r"), Path("runs/r")))
    assert "--resume" in caught.value.hint
    check_accepted("record", Run(Path("runs/r"), Path("runs/r")))
