"""Commands in a folder full of programs and modules that must not run, the run's own among them.

Only here is ``ludus`` a process of its own: a fork has imported most of it before.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys

from tests.campaign.processes import MARK
from tests.campaign.promises import ERRORS, check_nothing_left, check_nothing_ran
from tests.campaign.rounds import CANARIES, DEADLINE_S, Finding, Round

__all__ = ["start_among_strangers"]

COMMANDS = (
    ("train", "gym:CartPole-v1", "--total-steps", "64", "--evaluation-episodes", "0",
     "--num-worlds", "2", "--ppo.rollout-steps", "8", "--name", "run"),
    ("runs", "--json"),
    ("engine", "list"),
    ("engine", "doctor"),
    ("check", "gym:CartPole-v1"),
    ("evaluate", "runs/run"),
    ("export", "runs/run"),
    ("league", "runs/run"),
    ("train", "--resume", "runs/run"),
    ("record", "runs/run", "--out", "film.gif"),
    ("addon", "--help"),
)  # fmt: skip


def start_among_strangers(the_round: Round) -> None:
    """Run a few commands there, half of the time on a run that names one of these programs."""
    the_round.finish()
    if the_round.chance.random() < 0.5:
        config = the_round.run / "config.json"
        program = str(the_round.folder / the_round.chance.choice(CANARIES))
        setting = the_round.chance.choice(["target", "godot"])
        the_round.decide(f"{setting} of the run: {program}")
        config.write_text(json.dumps({**json.loads(config.read_text()), setting: program}))
    for _ in range(2):
        command = the_round.chance.choice(COMMANDS)
        the_round.decide(f"ludus {' '.join(command)}")
        the_round.counts["commands"] += 1
        done = subprocess.run(
            [sys.executable, "-m", "ludus", *command],
            cwd=the_round.folder,
            env={
                **os.environ,
                "TMPDIR": str(the_round.temporary),
                MARK: str(the_round.folder),
            },
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=DEADLINE_S,
            check=False,
        )
        text = (done.stdout + done.stderr).decode(errors="replace")
        if (
            done.returncode not in {0, 1, *ERRORS}
            or "this is a defect" in text
            or "Traceback" in text
        ):
            raise Finding(f"ludus {' '.join(command)} ended with {done.returncode}:\n{text}")
    check_nothing_left(the_round)
    check_nothing_ran(the_round)
