"""The whole game of docs/bevy.md is built as it stands there, and passes all checks."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from ludus.check import CheckConfig, CheckReport, Status, run_checks
from tests.legacy.gymgodot.conftest import ROOT

pytestmark = [pytest.mark.engine, pytest.mark.bevy, pytest.mark.timeout(600, func_only=True)]

PAGE = (ROOT / "docs/bevy.md").read_text()
WORKSPACE = ROOT / "engines/bevy"
ISOLATED = r"\s*\.isolated_by\(.*?\}\)\s*\.layout\(WorldLayout::Grid\)"


def block(language: str) -> str:
    """Return the first code of a language after the page's headline."""
    found = re.search(rf"## A whole game.*?```{language}\n(.*?)```", PAGE, re.DOTALL)
    assert found
    return found[1]


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The package of the page; its dependencies in the versions that all tests use."""
    folder = tmp_path_factory.mktemp("page")
    (folder / "src").mkdir()
    manifest = block("toml")
    assert "path/to/ludus" in manifest
    (folder / "Cargo.toml").write_text(manifest.replace("path/to/ludus", str(ROOT)))
    shutil.copy(WORKSPACE / "Cargo.lock", folder)
    return folder


def build(package: Path, program: str) -> Path:
    """Build the package for development, which takes least, and return its executable."""
    (package / "src/main.rs").write_text(program)
    target = Path(os.environ.get("CARGO_TARGET_DIR", WORKSPACE / "target"))
    subprocess.run(
        ["cargo", "build", "--quiet"],
        cwd=package,
        env={**os.environ, "CARGO_TARGET_DIR": str(target)},
        check=True,
    )
    return target / "debug/runner"


def check(executable: Path) -> CheckReport:
    return run_checks(CheckConfig(target=executable, num_layout_worlds=8, timing_s=0.05))


def test_the_game_of_the_page_passes(package: Path) -> None:
    report = check(build(package, block("rust,no_run")))
    assert [f for _, f in report.findings if f.status in {Status.FAIL, Status.WARN}] == []
    verdict, _ = (found for name, found in report.findings if name == "layouts")
    assert verdict.data["verdict"] == "equal to the bit"


def test_a_game_with_one_layout_passes_in_that(package: Path) -> None:
    program, num_cuts = re.subn(ISOLATED, "", block("rust,no_run"), flags=re.DOTALL)
    assert num_cuts == 1
    report = check(build(package, program))
    assert [f for _, f in report.findings if f.status in {Status.FAIL, Status.WARN}] == []
    (layouts,) = (found for name, found in report.findings if name == "layouts")
    assert layouts.status is Status.INFO
    assert "does not run isolated" in layouts.detail
    assert "layout grid" in next(
        found.detail for _, found in report.findings if found.title.startswith("world i of")
    )
