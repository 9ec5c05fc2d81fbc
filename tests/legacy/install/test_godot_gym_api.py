"""`ludus addon install --legacy` in a project for godot_gym_api: what is replaced and kept."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from ludus.addon import LEGACY_PATH
from ludus.cli.addon import Install, run
from ludus.engine.config_file import parse_config
from ludus.errors import ConfigError
from ludus.legacy.addon import install_legacy_addon
from tests.legacy.install.originals import FOLDER, ORIGINALS, add_originals
from tests.legacy.install.test_godot_ai import tree

GAMES = Path(__file__).parents[1] / "godot_gym_api" / "project"
SCRIPTS = sorted(f"{FOLDER}/{path}" for path, _ in ORIGINALS.values())


@pytest.fixture
def project(tmp_path: Path) -> Path:
    folder = shutil.copytree(GAMES, tmp_path / "game")
    add_originals(folder)
    (folder / FOLDER / "rgb_camera.gd").write_text("class_name RGBCamera\nextends Spatial\n")
    return folder


def listed(project: Path) -> dict[str, str]:
    """Return the paths of the classes that the project file lists."""
    text = parse_config((project / "project.godot").read_text()).entries["/_global_script_classes"]
    names = [part.split('"')[1] for part in text.value.split('"class":')[1:]]
    paths = [part.split('"')[1] for part in text.value.split('"path":')[1:]]
    assert len(set(names)) == len(names), "each class once"
    return dict(zip(names, paths, strict=True))


def test_scripts_are_backed_up_and_forwarded(project: Path) -> None:
    before = tree(project)
    change = install_legacy_addon(project)
    assert (list(change.replaced), change.kept) == (SCRIPTS, "godot_gym_api.old")
    kept = tree(project / change.kept)
    assert kept == {".gdignore": b"", **{name: before[name] for name in SCRIPTS}}
    changed = [name for name, data in before.items() if (project / name).read_bytes() != data]
    assert sorted(changed) == [*SCRIPTS, "project.godot"]
    for path, _ in ORIGINALS.values():
        forwarding = (project / FOLDER / path).read_text()
        assert forwarding.startswith(f'extends "res://{LEGACY_PATH}/{Path(path).name}"\n')
        assert "class_name" not in forwarding


def test_the_project_lists_our_classes_with_the_icons_of_theirs(project: Path) -> None:
    install_legacy_addon(project)
    found = listed(project)
    for name, (path, _) in ORIGINALS.items():
        assert found[name] == f"res://{LEGACY_PATH}/{Path(path).name}"
    text = (project / "project.godot").read_text()
    assert f'"RLAgent": "res://{FOLDER}/icon.png"' in text
    bases = text.split('"class": "PhysicsFramesTimer"')[0]
    assert bases.rstrip().endswith('"base": "Reference",')


def test_repeating_changes_nothing(project: Path) -> None:
    install_legacy_addon(project)
    before = tree(project)
    assert install_legacy_addon(project).replaced == ()
    assert tree(project) == before


def test_what_was_begun_is_finished(project: Path) -> None:
    """As if it had stopped before the root class, which comes last."""
    install_legacy_addon(project)
    root = project / FOLDER / ORIGINALS["RLEnvironment"][0]
    root.write_text("extends Spatial\nclass_name RLEnvironment\n")
    agent = project / FOLDER / ORIGINALS["RLAgent"][0]
    agent.write_text("extends Spatial\nclass_name RLAgent\n")
    change = install_legacy_addon(project)
    assert change.kept == "godot_gym_api.old-1"
    assert len(change.replaced) == 2


def test_gymgodot_beside_it(project: Path) -> None:
    script = GAMES.parents[1] / "gymgodot" / "project" / "GymGodot.gd"
    shutil.copy(script, project)
    change = install_legacy_addon(project)
    assert list(change.replaced) == sorted([*SCRIPTS, "GymGodot.gd"])
    assert (project / change.kept / "GymGodot.gd").read_bytes() == script.read_bytes()


def test_classes_that_are_not_its_own(project: Path) -> None:
    (project / FOLDER / ORIGINALS["RLEnvironment"][0]).unlink()
    before = tree(project)
    with pytest.raises(ConfigError, match=rf"(?s)RLAgent: {FOLDER}/rl_agent\.gd") as caught:
        install_legacy_addon(project)
    assert "no RLEnvironment in a rl_environment.gd" in caught.value.hint
    assert tree(project) == before


def test_the_command_says_what_it_did(project: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(Install(project, legacy=True)) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[2:] == [f"  replaced: {name} (kept in godot_gym_api.old)" for name in SCRIPTS]
