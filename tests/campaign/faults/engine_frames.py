"""What a trainer sends, changed, read by the add-on in a real Godot: no script may fail."""

from __future__ import annotations

import re
import subprocess

from ludus.engine import EngineKind, ensure_imported, find_engine, read_project
from ludus.engine.bundled import runnable_bundled_root
from tests.campaign.rounds import DEADLINE_S, Finding, Round
from tests.wire.golden import FOLDER

__all__ = ["fuzz_godot"]

FRAMES = 20_000


def fuzz_godot(the_round: Round) -> None:
    """Let Godot 4 read many frames; ``engines/godot4/tests/fuzz_frames.gd`` changes them."""
    seed = the_round.chance.getrandbits(32)
    the_round.decide(f"{FRAMES} frames in Godot 4 from seed {seed}")
    project = read_project(runnable_bundled_root(EngineKind.GODOT4))
    engine = find_engine(EngineKind.GODOT4)
    ensure_imported(engine, project)
    command = [str(engine.executable(headless=True)), "--headless", "--path", str(project.root)]
    options = [f"--golden={FOLDER}", f"--seed={seed}", f"--frames={FRAMES}"]
    done = subprocess.run(
        [*command, "-s", "tests/fuzz_frames.gd", "--", *options],
        capture_output=True,
        timeout=5 * DEADLINE_S,
        check=False,
    )
    output = (done.stderr + done.stdout).decode(errors="replace")
    summary = re.search(rb"^(\d+) frames, (\d+) read$", done.stdout, re.M)
    if done.returncode or summary is None or "SCRIPT ERROR" in output:
        raise Finding(f"Godot ended with exit code {done.returncode}:\n{output[:3000]}")
    the_round.counts["frames"] += int(summary[1])
    the_round.counts["frames in Godot"] += int(summary[1])
