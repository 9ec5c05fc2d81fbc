"""Export templates: which one is found for an engine, and how one is installed."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from engine_fakes import (
    FakeInstaller,
    FakeTemplateInstaller,
    fake_godot,
    refuse,
    visible,
)

from ludus.cli import main
from ludus.engine.doctor import FindingStatus, doctor
from ludus.engine.find import InstalledEngine
from ludus.engine.install import install_engine, install_template
from ludus.engine.kinds import EngineKind
from ludus.engine.official import platform_key
from ludus.engine.template import find_template, matching_template
from ludus.engine.version import release_name
from ludus.errors import ConfigError, SetupError

ENGINE = InstalledEngine(
    EngineKind.GODOT4, Path("/godot"), (4, 6, 3), "4.6.3.stable.debian4.6.3+ds-3", "PATH"
)


@pytest.fixture
def templates(tmp_path: Path, bare_machine: Path) -> Path:
    return tmp_path / "cache" / "ludus" / "templates" / "godot4"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("4.6.3.stable.debian4.6.3+ds-3", "4.6.3.stable"),
        ("4.6.stable.official.89cea1439", "4.6.stable"),
        ("4.7.rc2.official.abc", "4.7.rc2"),
        ("4.6.3.stable.mono.official.abc", "4.6.3.stable.mono"),
        ("4.6.3.stable", "4.6.3.stable"),
        ("nonsense", "nonsense"),
    ],
)
def test_release_is_what_templates_are_named_after(text: str, expected: str) -> None:
    assert release_name(text) == expected


def test_installed_template_is_found_and_reused(templates: Path) -> None:
    installer = FakeTemplateInstaller()
    installed = install_template(ENGINE, installers=[installer])
    assert installed.path == templates / "4.6.3.stable-official" / "godot"
    assert (installed.prefix, installed.source) == (None, "cache (official)")
    assert find_template(ENGINE) == installed == install_template(ENGINE, installers=[installer])
    assert len(installer.calls) == 1
    assert install_template(ENGINE, installers=[installer], force=True) == installed
    assert len(installer.calls) == 2
    assert visible(templates) == ["4.6.3.stable-official"]


def test_template_that_runs_anywhere_goes_first(templates: Path) -> None:
    bound = install_template(
        ENGINE, installers=[FakeTemplateInstaller(name="debian", needs_prefix=True)]
    )
    assert bound.prefix == templates / "4.6.3.stable-debian"
    free = install_template(ENGINE, installers=[FakeTemplateInstaller(name="official")], force=True)
    assert find_template(ENGINE) == free
    assert visible(templates) == ["4.6.3.stable-debian", "4.6.3.stable-official"]


def test_template_of_the_editor_is_found(tmp_path: Path, bare_machine: Path) -> None:
    name = "linux_release." + platform_key().removeprefix("linux-")
    path = tmp_path / "data" / "godot" / "export_templates" / "4.6.3.stable" / name
    fake_godot(path, "4.6.3.stable.official")
    template = find_template(ENGINE)
    assert (template.path, template.source) == (path, "Godot's own")
    assert matching_template(replace(ENGINE, version_text="4.6.2.stable.official")) is None


def test_template_of_another_release_is_refused_with_its_version(templates: Path) -> None:
    install_template(ENGINE, installers=[FakeTemplateInstaller()])
    newer = replace(ENGINE, version=(4, 6, 4), version_text="4.6.4.stable.official.def")
    with pytest.raises(SetupError) as caught:
        find_template(newer)
    assert "which is 4.6.4.stable.official.def" in caught.value.message
    assert "templates of: 4.6.3.stable.official.abc (cache (official))" in caught.value.message
    assert caught.value.hint.startswith("ludus engine install godot4 --templates")


def test_installers_with_another_release_tell_which_and_leave_nothing(templates: Path) -> None:
    installers = [
        FakeTemplateInstaller(act=refuse),
        FakeTemplateInstaller(version="4.7.stable", name="debian"),
    ]
    with pytest.raises(SetupError) as caught:
        install_template(ENGINE, installers=installers)
    assert caught.value.message.splitlines() == [
        f"an export template for /godot ({ENGINE.version_text}) could not be installed:",
        "  official: no network",
        "  debian: its template is 4.7.stable, expected 4.6.3.stable",
    ]
    assert "--templates --force" in caught.value.hint
    assert visible(templates) == []


def test_template_that_does_not_start_is_not_installed(templates: Path) -> None:
    with pytest.raises(SetupError, match="does not start"):
        install_template(ENGINE, installers=[FakeTemplateInstaller(version="nonsense")])
    assert visible(templates) == []


def test_broken_records_are_ignored(templates: Path) -> None:
    good = install_template(ENGINE, installers=[FakeTemplateInstaller()])
    number = '{"version_text": 4, "route": "debian", "executable": 5, "prefix": ""}'
    for name, text in [("a", "{"), ("b", "[]"), ("c", '{"route": "debian"}'), ("d", number)]:
        (templates / name).mkdir()
        (templates / name / "template.json").write_text(text)
    assert find_template(ENGINE) == good
    good.path.unlink()
    assert matching_template(ENGINE) is None


def test_only_godot_4_has_templates(bare_machine: Path) -> None:
    with pytest.raises(ConfigError, match="not for Godot 3"):
        install_template(replace(ENGINE, kind=EngineKind.GODOT3), installers=[])


def test_list_and_doctor_show_the_template(
    templates: Path, bare_machine: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    godot = fake_godot(bare_machine / "godot4", ENGINE.version_text)
    assert main(["engine", "list", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)[0]["template"] is None
    finding = next(item for item in doctor() if item.name == "template")
    assert finding.status is FindingStatus.WARN
    assert "none to export games with 4.6.3.stable; there are: none" in finding.detail
    assert finding.hint == "to export games: ludus engine install godot4 --templates"

    template = install_template(ENGINE, installers=[FakeTemplateInstaller()])
    assert main(["engine", "list", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)[0]["template"] == str(template.path)
    assert main(["engine", "list"]) == 0
    assert capsys.readouterr().out.splitlines() == [
        f"godot4  {ENGINE.version_text}  {godot}  (PATH)",
        f"  export template  {template.path}  (cache (official))",
    ]
    finding = next(item for item in doctor() if item.name == "template")
    assert finding.status is FindingStatus.OK
    assert finding.detail == f"{template.version_text} {template.path} [cache (official)]"


def test_install_command_reports_both(
    templates: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def engine_of(kind: EngineKind, **options: object) -> InstalledEngine:
        return install_engine(kind, installers=[FakeInstaller(version="4.6.3.stable.fake")])

    def template_of(engine: InstalledEngine, **options: object) -> object:
        return install_template(engine, installers=[FakeTemplateInstaller()])

    monkeypatch.setattr("ludus.engine.install_engine", engine_of)
    monkeypatch.setattr("ludus.engine.install_template", template_of)
    assert main(["engine", "install", "godot4"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 1
    assert main(["engine", "install", "godot4", "--templates"]) == 0
    engine_line, template_line = capsys.readouterr().out.splitlines()
    assert engine_line.startswith("godot4 4.6.3.stable.fake: ")
    assert template_line.startswith("export template 4.6.3.stable.official.abc: ")
