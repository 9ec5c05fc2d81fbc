"""The Godot 3 add-on's own tests, in GDScript, run by the real engine."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from ludus.engine import EngineKind, InstalledEngine
from ludus.engine.bundled import runnable_bundled_root
from ludus.engine.script_classes import add_script_classes, find_script_classes
from tests.wire.golden import FOLDER

pytestmark = pytest.mark.engine


def run(engine: InstalledEngine, golden: Path, *options: str) -> tuple[int, str]:
    program = str(engine.executable(headless=True))
    root = runnable_bundled_root(EngineKind.GODOT3)
    command = [program, "--path", str(root), "-s", "tests/run_tests.gd"]
    done = subprocess.run(
        [*command, "--", f"--golden={golden}", *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        timeout=120,
        check=False,
    )
    return done.returncode, done.stdout.decode(errors="replace")


def test_all_pass(godot3: InstalledEngine) -> None:
    code, output = run(godot3, FOLDER)
    summary = re.search(r"^(\d+) passed, (\d+) failed$", output, re.M)
    assert summary is not None, output
    assert code == 0, output
    assert summary[2] == "0", output
    assert "SCRIPT ERROR" not in output, output
    files = list((runnable_bundled_root(EngineKind.GODOT3) / "tests").glob("test_*.gd"))
    num_tests = sum(file.read_text().count("\nfunc test_") for file in files)
    assert int(summary[1]) == num_tests > 0, output


def test_a_wrong_golden_frame_is_noticed(godot3: InstalledEngine, tmp_path: Path) -> None:
    folder = tmp_path / "golden"
    shutil.copytree(FOLDER, folder)
    described = json.loads((folder / "batch_dictionary.json").read_text())
    described["content"]["policies"]["scout"]["reward"][1] = 3.0
    (folder / "batch_dictionary.json").write_text(json.dumps(described))
    code, output = run(godot3, folder, "--only=test_golden.gd")
    assert code == 1, output
    assert "FAILED test_golden.gd test_batch_is_written: batch_dictionary: expected" in output
    assert re.search(r"^[1-9]\d* passed, 1 failed$", output, re.M), output


def test_the_project_file_lists_all_classes() -> None:
    root = runnable_bundled_root(EngineKind.GODOT3)
    text = (root / "project.godot").read_text()
    scripts = find_script_classes(root / "addons/ludus", "res://addons/ludus")
    assert add_script_classes(text, scripts) == text
    assert text.count('"class":') == len(scripts)
