"""CleanRL's scripts with the lines of docs/libraries/cleanrl.md changed train in real Godot.

The scripts are downloaded by `make test-libraries`: they are no part of this project.
"""

from __future__ import annotations

import hashlib
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import CLEANRL

PAGE = Path(__file__).parents[2] / "docs/libraries/cleanrl.md"
SCRIPTS = {
    "ppo.py": "d8dfbb7ac0b21e747b77d6e6673e566db4d6cdacc83bcebcd19cf87ad0e459ae",
    "ppo_continuous_action.py": "326dd8678bf9cc51abec833eb551ef2409a3804d604b689e1f0a084eca41f655",
}
"""Names and SHA-256 of the files of the commit that the page names."""

pytestmark = [
    pytest.mark.cleanrl,
    pytest.mark.libraries,
    pytest.mark.engine,
    pytest.mark.timeout(400, func_only=True),
]


def read_script(name: str) -> str:
    path = CLEANRL / name
    assert hashlib.sha256(path.read_bytes()).hexdigest() == SCRIPTS[name]
    return path.read_text()


def read_hunks(name: str) -> list[tuple[str, str, int]]:
    """Return what the page replaces in a script: old lines, new lines, how many of them are new."""
    diffs = re.findall(r"```diff\n(.*?)```", PAGE.read_text(), re.DOTALL)
    hunks = diffs[list(SCRIPTS).index(name)].split("\n\n")
    lines = [hunk.strip("\n").splitlines() for hunk in hunks]
    return [
        (
            "".join(f"{line[1:]}\n" for line in hunk if line[0] in " -"),
            "".join(f"{line[1:]}\n" for line in hunk if line[0] in " +"),
            sum(line[0] == "+" for line in hunk),
        )
        for hunk in lines
    ]


@pytest.mark.parametrize("name", SCRIPTS)
def test_three_changed_lines_train_in_godot(name: str, tmp_path: Path) -> None:
    text, hunks = read_script(name), read_hunks(name)
    assert sum(num_new for *_, num_new in hunks) == 3
    for old, new, _ in hunks:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    (tmp_path / name).write_text(text)
    flags = ["--num-envs", "16", "--num-steps", "64", "--total-timesteps", "12288", "--no-cuda"]
    flags += ["--num-minibatches", "4", "--update-epochs", "2"]
    done = subprocess.run(
        [sys.executable, name, *flags, "--no-torch-deterministic"],
        capture_output=True, text=True, check=False, cwd=tmp_path,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    assert re.search(r"global_step=\d+, episodic_return=\[?-?\d+\.\d+", done.stdout), done.stdout
    rates = [int(rate) for rate in re.findall(r"^SPS: (\d+)$", done.stdout, re.MULTILINE)]
    assert len(rates) == 12
