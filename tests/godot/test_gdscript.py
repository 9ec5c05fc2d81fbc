"""The add-on's own tests, in GDScript, run by the real engine."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from ludus.engine import EngineKind, ensure_imported, find_engine, read_project
from ludus.engine.bundled import runnable_bundled_root
from tests.wire.golden import FOLDER

pytestmark = pytest.mark.engine


@pytest.fixture(params=[EngineKind.GODOT4, EngineKind.GODOT3], ids=str)
def kind(request: pytest.FixtureRequest) -> EngineKind:
    return request.param


def run(kind: EngineKind, golden: Path, *options: str) -> tuple[int, str]:
    project, engine = read_project(runnable_bundled_root(kind)), find_engine(kind)
    ensure_imported(engine, project)
    command = [str(engine.executable(headless=True)), "--path", str(project.root)]
    command += ["--headless"] if kind is EngineKind.GODOT4 else []
    command += ["-s", "tests/run_tests.gd"]
    done = subprocess.run(
        [*command, "--", f"--golden={golden}", *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        timeout=120,
        check=False,
    )
    return done.returncode, done.stdout.decode(errors="replace")


def test_all_pass(kind: EngineKind) -> None:
    code, output = run(kind, FOLDER)
    summary = re.search(r"^(\d+) passed, (\d+) failed$", output, re.M)
    assert summary is not None, output
    assert code == 0, output
    assert summary[2] == "0", output
    assert "SCRIPT ERROR" not in output, output
    files = list((runnable_bundled_root(kind) / "tests").glob("test_*.gd"))
    num_tests = sum(file.read_text().count("\nfunc test_") for file in files)
    assert int(summary[1]) == num_tests > 0, output


def test_a_wrong_golden_frame_is_noticed(kind: EngineKind, tmp_path: Path) -> None:
    folder = tmp_path / "golden"
    shutil.copytree(FOLDER, folder)
    described = json.loads((folder / "batch_dictionary.json").read_text())
    described["content"]["policies"]["scout"]["reward"][1] = 3.0
    (folder / "batch_dictionary.json").write_text(json.dumps(described))
    code, output = run(kind, folder, "--only=test_golden.gd")
    assert code == 1, output
    assert "FAILED test_golden.gd test_batch_is_written: batch_dictionary: expected" in output
    assert re.search(r"^[1-9]\d* passed, 1 failed$", output, re.M), output
