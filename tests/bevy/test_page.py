"""The game of docs/bevy.md and ``ludus new --bevy``, built with the crates as published."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import tarfile
import tomllib
from pathlib import Path

import pytest

from ludus.check import CheckConfig, CheckReport, Status, run_checks
from ludus.cli.main import main
from ludus.runs.metrics import read_metrics
from tests.legacy.gymgodot.conftest import ROOT

pytestmark = [pytest.mark.engine, pytest.mark.bevy, pytest.mark.timeout(600, func_only=True)]

PAGE = (ROOT / "docs/bevy.md").read_text()
WORKSPACE = ROOT / "engines/bevy"
CHECKOUT = "path/to/ludus/engines/bevy/crates"
PUBLISHED = ("bevy_ludus_derive", "bevy_ludus", "bevy_ludus_rest")
BEGUN = "*runner = Runner { position: 0.0, flag: world.random.range(-0.9..0.9) };"
REPORT = 'world.report_metric("flag", runner.flag);'
ISOLATED = r"\s*\.isolated_by\(.*?\}\)\s*\.layout\(WorldLayout::Grid\)"


def block(language: str) -> str:
    """Return the first code of a language after the page's headline."""
    found = re.search(rf"## A whole game.*?```{language}\n(.*?)```", PAGE, re.DOTALL)
    assert found
    return found[1]


@pytest.fixture(scope="module")
def crates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the crates, taken out of the files that Cargo would upload."""
    folder = tmp_path_factory.mktemp("crates")
    # What they depend on is built below, by the game; verifying would build all of it once more.
    cargo = ["cargo", "package", "--workspace", "--quiet", "--allow-dirty", "--no-verify"]
    subprocess.run([*cargo, "--target-dir", str(folder)], cwd=WORKSPACE, check=True)
    for crate in PUBLISHED:
        (file,) = (folder / "package").glob(f"{crate}-[0-9]*.crate")
        with tarfile.open(file) as archive:
            archive.extractall(folder, filter="data")
        (folder / file.stem).rename(folder / crate)
    return folder


@pytest.fixture(scope="module")
def package(crates: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What ``ludus new`` makes; its dependencies in the versions that all tests use."""
    folder = tmp_path_factory.mktemp("page") / "runner"
    assert main(["new", str(folder), "--bevy"]) == 0
    manifest = (folder / "Cargo.toml").read_text().replace(f"{WORKSPACE}/crates", CHECKOUT)
    assert manifest == block("toml")
    assert (folder / "src/main.rs").read_text() == block("rust,no_run")
    # The crate for the macros is not on crates.io; and this builds on the Bevy of the examples.
    more = f"""
[dependencies.workspace_hack]
path = "{WORKSPACE}/workspace_hack"

[patch.crates-io]
bevy_ludus_derive = {{ path = "{crates}/bevy_ludus_derive" }}
"""
    (folder / "Cargo.toml").write_text(manifest.replace(CHECKOUT, str(crates)) + more)
    shutil.copy(WORKSPACE / "Cargo.lock", folder)
    return folder


@pytest.fixture(autouse=True)
def target_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    """Builds use the Bevy of the examples without pictures."""
    target = os.environ.get("CARGO_TARGET_DIR", str(WORKSPACE / "target"))
    monkeypatch.setenv("CARGO_TARGET_DIR", target)


@pytest.mark.parametrize("crate", PUBLISHED)
def test_a_crate_holds_all_that_it_needs(crates: Path, crate: str) -> None:
    for name in ("LICENSE", "README.md", "Cargo.toml", "src/lib.rs"):
        assert (crates / crate / name).read_text(), name
    manifest = tomllib.loads((crates / crate / "Cargo.toml").read_text())
    assert {"description", "license", "keywords", "categories"} <= manifest["package"].keys()
    if crate == "bevy_ludus":
        golden = crates / crate / "tests/golden"
        assert (golden / "hello.bin").read_bytes() == (
            ROOT / "protocol/golden/hello.bin"
        ).read_bytes()
        assert list((golden / "policies").glob("*.ludus.json"))


def check(package: Path, program: str) -> CheckReport:
    (package / "src/main.rs").write_text(program)
    return run_checks(CheckConfig(target=package, num_layout_worlds=8, timing_s=0.05))


def test_the_game_of_the_page_passes(package: Path) -> None:
    report = check(package, block("rust,no_run"))
    assert [f for _, f in report.findings if f.status in {Status.FAIL, Status.WARN}] == []
    verdict, _ = (found for name, found in report.findings if name == "layouts")
    assert verdict.data["verdict"] == "equal to the bit"


def test_the_game_of_the_page_trains_and_its_metrics_arrive(package: Path, tmp_path: Path) -> None:
    program = block("rust,no_run")
    assert program.count(BEGUN) == 1
    (package / "src/main.rs").write_text(program.replace(BEGUN, f"{BEGUN}\n{REPORT}"))
    arguments = [
        "train", str(package), "--total-steps", "512", "--num-worlds", "8", "--num-engines", "1",
        "--runs", str(tmp_path), "--name", "short", "--ppo.rollout-steps", "16",
    ]  # fmt: skip
    assert main(arguments) == 0
    lines = read_metrics(tmp_path / "short" / "metrics.jsonl")
    flags = [line["game"]["flag"] for line in lines if "game" in line]
    assert flags
    assert all(-0.9 <= flag["min"] <= flag["mean"] <= flag["max"] <= 0.9 for flag in flags)
    ended = lines[-1]["policies"]["runner"]["episodes"]
    assert sum(flag["count"] for flag in flags) == ended + 8, "each world is in an episode"


def test_a_game_with_one_layout_passes_in_that(package: Path) -> None:
    program, num_cuts = re.subn(ISOLATED, "", block("rust,no_run"), flags=re.DOTALL)
    assert num_cuts == 1
    report = check(package, program)
    assert [f for _, f in report.findings if f.status in {Status.FAIL, Status.WARN}] == []
    (layouts,) = (found for name, found in report.findings if name == "layouts")
    assert layouts.status is Status.INFO
    assert "does not run isolated" in layouts.detail
    assert "layout grid" in next(
        found.detail for _, found in report.findings if found.title.startswith("world i of")
    )
