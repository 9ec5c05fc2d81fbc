"""`ludus addon install --legacy`: what is replaced, what is kept, what is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from ludus.addon import LEGACY_PATH, MANIFEST_NAME, install_addon
from ludus.cli.addon import Install, run
from ludus.cli.main import main
from ludus.errors import ConfigError
from ludus.legacy.addon import install_legacy_addon
from tests.legacy.godot_ai.projects import GAME, GODOT_AI, original_game

SCRIPTS = sorted(file.relative_to(GODOT_AI).as_posix() for file in GODOT_AI.rglob("*.gd"))


@pytest.fixture
def project(tmp_path: Path) -> Path:
    return original_game(tmp_path / "game")


def tree(folder: Path) -> dict[str, bytes]:
    return {
        file.relative_to(folder).as_posix(): file.read_bytes()
        for file in folder.rglob("*")
        if file.is_file()
    }


def test_godot_ai_is_backed_up_and_forwarded(project: Path) -> None:
    (project / "AI" / "AIRunner.gd.uid").write_text("uid://cairunner00001\n")
    change = install_legacy_addon(project)
    assert list(change.replaced) == SCRIPTS
    assert change.kept == "godot-ai.old"
    kept = tree(project / "godot-ai.old")
    assert kept.pop(".gdignore") == b""
    assert kept == {name: (GODOT_AI / name).read_bytes() for name in SCRIPTS}
    forwarding = (project / "AI" / "AIRunner.gd").read_text()
    assert forwarding.startswith('extends "res://addons/ludus_classic/ai_runner.gd"\n')
    assert "class_name" not in forwarding
    assert (project / "AI" / "AIRunner.gd.uid").read_text() == "uid://cairunner00001\n"
    for name, content in tree(GAME).items():
        if name != "project.godot":
            assert (project / name).read_bytes() == content, "the game itself is not touched"
    assert not list(project.rglob("*.incoming"))


def test_a_game_of_no_bridge_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "project.godot").write_text(
        'config_version=5\n[application]\nconfig/features=PackedStringArray("4.4")\n'
    )
    (tmp_path / "game.gd").write_text("extends Node\n# nothing of AIBaseEnvironments\n")
    before = tree(tmp_path)
    with pytest.raises(ConfigError, match=r"not written for godot-ai.*nothing was installed"):
        install_legacy_addon(tmp_path)
    assert tree(tmp_path) == before


def test_repeating_changes_nothing(project: Path) -> None:
    install_legacy_addon(project)
    before = tree(project)
    change = install_legacy_addon(project)
    assert (change.replaced, change.kept) == ((), "")
    assert tree(project) == before


def test_a_second_copy_of_godot_ai_is_kept_beside_the_first(project: Path) -> None:
    install_legacy_addon(project)
    for name in SCRIPTS:
        (project / name).write_bytes((GODOT_AI / name).read_bytes())
    assert install_legacy_addon(project).kept == "godot-ai.old-1"
    assert tree(project / "godot-ai.old") == tree(project / "godot-ai.old-1")


def test_a_game_that_lacks_godot_ai_gets_the_classes(tmp_path: Path) -> None:
    (tmp_path / "project.godot").write_text("config_version=5\n")
    (tmp_path / "game.gd").write_text("extends AIBaseEnvironment\n")
    change = install_legacy_addon(tmp_path)
    assert change.replaced == ()
    assert "ai_runner.gd" in change.legacy.added
    assert not (tmp_path / "godot-ai.old").exists()


def test_a_class_of_the_game_is_not_taken_for_one_of_godot_ai(tmp_path: Path) -> None:
    (tmp_path / "project.godot").write_text("config_version=5\n")
    (tmp_path / "film.gd").write_text("class_name Replay\nextends Node\n")
    before = tree(tmp_path)
    with pytest.raises(ConfigError, match=r"Replay: film\.gd") as caught:
        install_legacy_addon(tmp_path)
    assert "rename" in caught.value.hint
    assert tree(tmp_path) == before


def test_what_godot_does_not_look_into_is_left_alone(project: Path) -> None:
    for folder in (".godot", "attic"):
        (project / folder).mkdir()
        (project / folder / "Replay.gd").write_text("class_name Replay\n")
    (project / "attic" / ".gdignore").touch()
    assert list(install_legacy_addon(project).replaced) == SCRIPTS


def test_the_classes_are_upgraded_with_the_add_on(project: Path) -> None:
    install_addon(project)
    assert not (project / LEGACY_PATH).exists(), "only where they were asked for"
    install_legacy_addon(project)
    own = project / LEGACY_PATH / "replay.gd"
    own.unlink()
    install_addon(project)
    assert own.is_file()
    own.write_text("changed by hand\n")
    with pytest.raises(ConfigError, match="ludus_classic/replay"):
        install_addon(project)
    install_addon(project, force=True)
    assert own.read_text() != "changed by hand\n"
    assert (project / LEGACY_PATH / MANIFEST_NAME).is_file()


def test_classic_names_the_new_flag(project: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["addon", "install", "--classic", str(project)]) == 0
    output = capsys.readouterr()
    assert output.err == "--classic is now called --legacy\n"
    assert "replaced: " in output.out


def test_the_command_says_what_it_did(project: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(Install(project, legacy=True)) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("ludus add-on")
    assert lines[1].startswith("ludus_classic")
    replaced = [line for line in lines if line.startswith("  replaced: ")]
    assert replaced == [f"  replaced: {name} (kept in godot-ai.old)" for name in SCRIPTS]
