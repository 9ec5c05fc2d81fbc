"""Installing the add-on: upgrade what is ours, never what the user changed."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from ludus.addon import (
    MANIFEST_NAME,
    AddonChange,
    AddonStatus,
    addon_status,
    install,
    install_addon,
)
from ludus.engine import EngineKind
from ludus.errors import ConfigError, SetupError, TargetError

PROJECT_TEXT = """\
; mine
config_version=5

[editor_plugins]

enabled=PackedStringArray("res://addons/other/plugin.cfg")

[rendering]

a="b"
"""


@pytest.fixture
def source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Version 1 of the add-on, as it comes with Ludus."""
    folder = tmp_path / "bundled" / "addons" / "ludus"
    (folder / "icons").mkdir(parents=True)
    (folder / "plugin.cfg").write_text("[plugin]\n")
    (folder / "agent.gd").write_text("extends Node\n")
    (folder / "old.gd").write_text("extends Node\n")
    (folder / "icons" / "agent.svg").write_text("<svg/>\n")
    (folder / ".godot").mkdir()
    (folder / ".godot" / "cache").touch()

    def bundled_root(_kind: EngineKind) -> Path:
        return tmp_path / "bundled"

    monkeypatch.setattr(install, "bundled_root", bundled_root)
    monkeypatch.setattr(install, "package_version", lambda: "1")
    return folder


@pytest.fixture
def project(tmp_path: Path) -> Path:
    root = tmp_path / "game"
    root.mkdir()
    (root / "project.godot").write_text(PROJECT_TEXT)
    return root


def make_version_2(source: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(install, "package_version", lambda: "2")
    (source / "agent.gd").write_text("extends Node2D\n")
    (source / "old.gd").unlink()
    (source / "new.gd").write_text("extends Node\n")


def tree(folder: Path) -> dict[str, bytes]:
    return {
        file.relative_to(folder).as_posix(): file.read_bytes()
        for file in folder.rglob("*")
        if file.is_file()
    }


def test_fresh_installation(source: Path, project: Path) -> None:
    assert not addon_status(project).is_present
    change = install_addon(project)
    assert change.added == ("agent.gd", "icons/agent.svg", "old.gd", "plugin.cfg")
    assert (change.version_before, change.version_after) == (None, "1")
    assert change.has_enabled_plugin
    installed = tree(project / "addons" / "ludus")
    assert set(installed) == {*change.added, MANIFEST_NAME}
    manifest = json.loads(installed[MANIFEST_NAME])
    assert manifest["version"] == "1"
    assert set(manifest["files"]) == set(change.added)
    assert [entry.name for entry in (project / "addons").iterdir()] == ["ludus"]
    status = addon_status(project)
    assert status == AddonStatus("1", True, True, True, ())


def test_plugin_is_switched_on_and_the_rest_stays(source: Path, project: Path) -> None:
    (project / "project.godot").chmod(0o600)
    install_addon(project)
    text = (project / "project.godot").read_text()
    switched_on = PROJECT_TEXT.replace(
        'other/plugin.cfg"', 'other/plugin.cfg", "res://addons/ludus/plugin.cfg"'
    )
    autoload = 'Ludus="*res://addons/ludus/bridge/ludus_bridge.gd"'
    assert text.rstrip("\n") == f"{switched_on.rstrip()}\n\n[autoload]\n\n{autoload}"
    assert (project / "project.godot").stat().st_mode & 0o777 == 0o600
    assert sorted(entry.name for entry in project.iterdir()) == ["addons", "project.godot"]


def test_windows_line_ends_survive(source: Path, project: Path) -> None:
    text = PROJECT_TEXT.replace("\n", "\r\n").encode()
    (project / "project.godot").write_bytes(text)
    install_addon(project)
    after = (project / "project.godot").read_bytes()
    assert after.count(b"\r\n") == after.count(b"\n") > text.count(b"\n")


def test_repeating_changes_nothing(source: Path, project: Path) -> None:
    install_addon(project)
    before = {file: file.stat().st_mtime_ns for file in project.rglob("*")}
    change = install_addon(project)
    assert change == AddonChange("1", "1")
    assert {file: file.stat().st_mtime_ns for file in project.rglob("*")} == before


def test_upgrade(source: Path, project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install_addon(project)
    make_version_2(source, monkeypatch)
    assert not addon_status(project).is_current
    change = install_addon(project)
    assert change == AddonChange("1", "2", ("new.gd",), ("agent.gd",), ("old.gd",))
    installed = tree(project / "addons" / "ludus")
    assert set(installed) == {"agent.gd", "icons/agent.svg", "new.gd", "plugin.cfg", MANIFEST_NAME}
    assert installed["agent.gd"] == b"extends Node2D\n"
    assert addon_status(project).is_current


@pytest.mark.parametrize("name", ["agent.gd", "old.gd"])
def test_changed_files_are_refused_or_forced(
    name: str, source: Path, project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    install_addon(project)
    (project / "addons" / "ludus" / name).write_text("my own\n")
    make_version_2(source, monkeypatch)
    before = tree(project)
    assert addon_status(project).changed == (name,)
    with pytest.raises(ConfigError, match=f"addons/ludus/{name}") as caught:
        install_addon(project)
    assert "--force" in caught.value.hint
    assert tree(project) == before
    install_addon(project, force=True)
    assert addon_status(project).is_current
    assert not (project / "addons" / "ludus" / "old.gd").exists()


def test_line_ends_are_no_change(source: Path, project: Path) -> None:
    install_addon(project)
    (project / "addons" / "ludus" / "agent.gd").write_bytes(b"extends Node\r\n")
    assert addon_status(project).changed == ()


def test_change_that_the_new_version_makes_too_is_fine(
    source: Path, project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    install_addon(project)
    make_version_2(source, monkeypatch)
    (project / "addons" / "ludus" / "agent.gd").write_text("extends Node2D\n")
    assert install_addon(project).updated == ()


def test_files_of_the_user_are_kept(
    source: Path, project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    install_addon(project)
    (project / "addons" / "ludus" / "agent.gd.uid").write_text("uid://a\n")
    make_version_2(source, monkeypatch)
    install_addon(project)
    assert (project / "addons" / "ludus" / "agent.gd.uid").read_text() == "uid://a\n"


def test_deleted_files_come_back(source: Path, project: Path) -> None:
    install_addon(project)
    (project / "addons" / "ludus" / "agent.gd").unlink()
    assert install_addon(project).added == ("agent.gd",)
    assert addon_status(project).is_current


@pytest.mark.parametrize("manifest", [None, "{", "[]", '{"files": 3}', '{"files": {}}'])
def test_copy_by_hand_is_taken_over_only_if_equal(
    manifest: str | None, source: Path, project: Path
) -> None:
    target = project / "addons" / "ludus"
    target.mkdir(parents=True)
    (target / "agent.gd").write_text("different\n")
    if manifest is not None:
        (target / MANIFEST_NAME).write_text(manifest)
    with pytest.raises(ConfigError, match=r"agent\.gd"):
        install_addon(project)
    (target / "agent.gd").write_text("extends Node\n")
    assert "agent.gd" not in install_addon(project).added
    assert addon_status(project).version == "1"


@pytest.mark.parametrize("fail_at", [1, 2])
def test_failure_half_way_leaves_the_old_version(
    fail_at: int, source: Path, project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    install_addon(project)
    make_version_2(source, monkeypatch)
    before = tree(project)
    real, calls = Path.rename, [0]

    def rename(self: Path, target: Path) -> Path:
        calls[0] += 1
        if calls[0] == fail_at:
            raise OSError(28, "No space left on device")
        return real(self, target)

    monkeypatch.setattr(Path, "rename", rename)
    with pytest.raises(SetupError, match="No space left"):
        install_addon(project)
    assert tree(project) == before
    assert [entry.name for entry in (project / "addons").iterdir()] == ["ludus"]


def test_disk_full_while_copying_leaves_the_old_version(
    source: Path, project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    install_addon(project)
    make_version_2(source, monkeypatch)
    before = tree(project)

    def fail(_source: Path, _target: Path) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(install, "_copy_file", fail)
    with pytest.raises(SetupError):
        install_addon(project)
    assert tree(project) == before


def test_links_are_left_alone(source: Path, project: Path, tmp_path: Path) -> None:
    (project / "addons").mkdir()
    (tmp_path / "elsewhere").mkdir()
    link = project / "addons" / "ludus"
    link.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(ConfigError, match="link"):
        install_addon(project)
    link.unlink()
    link.symlink_to(source)
    before = tree(source)
    install_addon(project)
    assert link.is_symlink()
    assert tree(source) == before
    assert addon_status(project).is_enabled


def test_only_godot_projects(source: Path, project: Path, tmp_path: Path) -> None:
    (project / "project.godot").write_text("config_version=3\n")
    with pytest.raises(TargetError, match="config_version 3"):
        install_addon(project)
    with pytest.raises(TargetError, match=r"no project\.godot"):
        install_addon(tmp_path)


def test_missing_bundle_is_reported(source: Path, project: Path) -> None:
    (source / "plugin.cfg").unlink()
    with pytest.raises(SetupError, match="lacks its add-on"):
        install_addon(project)


def test_add_on_of_this_checkout_can_be_installed(project: Path) -> None:
    change = install_addon(project)
    assert "plugin.cfg" in change.added
    assert addon_status(project).is_current


def test_links_out_of_the_project_are_neither_followed_nor_copied(
    source: Path, project: Path, tmp_path: Path
) -> None:
    secret = tmp_path / "secret"
    secret.write_text("password")
    (tmp_path / "folder").mkdir()
    install_addon(project)
    addon = project / "addons" / "ludus"
    (addon / "mine.gd").symlink_to(secret)
    (addon / "mine").symlink_to(tmp_path / "folder")
    (source / "agent.gd").write_text("extends Node  # new\n")
    assert install_addon(project).updated == ("agent.gd",)
    assert (addon / "mine.gd").readlink() == secret
    assert (addon / "mine").readlink() == tmp_path / "folder"
    (addon / "agent.gd").unlink()
    (addon / "agent.gd").symlink_to(secret)
    with pytest.raises(ConfigError, match=r"changed by hand:\n  addons/ludus/agent.gd"):
        install_addon(project)
    install_addon(project, force=True)
    assert (addon / "agent.gd").read_text() == "extends Node  # new\n"
    assert not (addon / "agent.gd").is_symlink()
    assert secret.read_text() == "password"


@pytest.mark.parametrize("name", ["addons", "project.godot"])
def test_a_linked_folder_or_project_file_is_refused(
    name: str, source: Path, project: Path, tmp_path: Path
) -> None:
    outside = tmp_path / "outside"
    if name == "addons":
        outside.mkdir()
    else:
        (project / name).rename(outside)
    (project / name).symlink_to(outside)
    with pytest.raises(ConfigError, match=f"{name} in .* is a link to {outside}"):
        install_addon(project)
    assert (project / name).is_symlink()
    assert name != "addons" or list(outside.iterdir()) == []


def test_links_in_the_place_of_temporary_files_are_not_followed(
    source: Path, project: Path, tmp_path: Path
) -> None:
    target = tmp_path / "target"
    target.write_text("mine")
    (project / f".project.godot.{os.getpid()}.tmp").symlink_to(target)
    install_addon(project)
    assert target.read_text() == "mine"
    assert "addons/ludus/plugin.cfg" in (project / "project.godot").read_text()
