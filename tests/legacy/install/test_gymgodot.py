"""`ludus addon install --legacy` in a Godot 3 project: what is replaced, kept, said, refused."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from ludus.addon import LEGACY_PATH, install_addon
from ludus.cli.addon import Install, run
from ludus.engine.bundled import bundled_root
from ludus.engine.kinds import EngineKind
from ludus.errors import ConfigError
from ludus.legacy.addon import install_legacy_addon
from ludus.legacy.addon_files import own_classes
from tests.legacy.install.test_godot_ai import tree

GAMES = Path(__file__).parents[1] / "gymgodot" / "project"


@pytest.fixture
def project(tmp_path: Path) -> Path:
    shutil.copytree(GAMES, tmp_path / "game")
    return tmp_path / "game"


def test_gymgodots_script_is_backed_up_and_forwarded(project: Path) -> None:
    before = tree(project)
    change = install_legacy_addon(project)
    assert (change.replaced, change.kept) == (("GymGodot.gd",), "gymgodot.old")
    kept = tree(project / "gymgodot.old")
    assert kept == {".gdignore": b"", "GymGodot.gd": before["GymGodot.gd"]}
    forwarding = (project / "GymGodot.gd").read_text()
    assert forwarding.startswith(f'extends "res://{LEGACY_PATH}/gym_godot.gd"\n')
    changed = [name for name, data in before.items() if (project / name).read_bytes() != data]
    assert sorted(changed) == ["GymGodot.gd", "project.godot"]


def test_the_whole_folder_comes_and_its_classes_are_listed(project: Path) -> None:
    install_legacy_addon(project)
    source = bundled_root(EngineKind.GODOT3) / LEGACY_PATH
    names = {file.relative_to(source) for file in source.rglob("*") if file.is_file()}
    assert {Path("GymGodot.tscn"), Path("gym_godot.gd")} <= names
    assert all((project / LEGACY_PATH / name).is_file() for name in names)
    text = (project / "project.godot").read_text()
    for name in ("LudusAgent", "LudusGymGodot", *own_classes(EngineKind.GODOT3)):
        assert text.count(f'"class": "{name}"') == 1


def test_repeating_changes_nothing(project: Path) -> None:
    install_legacy_addon(project)
    before = tree(project)
    assert install_legacy_addon(project).replaced == ()
    assert tree(project) == before


def test_it_is_upgraded_with_the_add_on(project: Path) -> None:
    install_addon(project)
    assert not (project / LEGACY_PATH).exists(), "only where it was asked for"
    install_legacy_addon(project)
    scene = project / LEGACY_PATH / "GymGodot.tscn"
    scene.unlink()
    install_addon(project)
    assert scene.is_file()


def test_a_script_of_that_name_which_is_something_else_stays(project: Path) -> None:
    (project / "GymGodot.gd").write_text("extends Node\n")
    assert install_legacy_addon(project).replaced == ()
    assert (project / "GymGodot.gd").read_text() == "extends Node\n"


def test_a_class_of_the_game_with_one_of_our_names(project: Path) -> None:
    name = sorted(own_classes(EngineKind.GODOT3))[0]
    (project / "own.gd").write_text(f"class_name {name}\nextends Node\n")
    before = tree(project)
    with pytest.raises(ConfigError, match=rf"{name}: own\.gd"):
        install_legacy_addon(project)
    assert tree(project) == before


def test_the_command_says_what_is_left_to_do(
    project: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = project / "walk.tscn"
    node = 'environmentNode = NodePath("../Walk")\n'
    scene.write_text(scene.read_text().replace(node, f"{node}continuous_size = 1\n"))
    assert run(Install(project, legacy=True)) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[2:] == [
        "  replaced: GymGodot.gd (kept in gymgodot.old)",
        "  cartpole.tscn: set discrete_n or continuous_size on its GymGodot node, as in Python",
    ]
