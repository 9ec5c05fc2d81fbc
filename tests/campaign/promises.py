"""The promises of Ludus that no fault may break; each check raises ``Finding``."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

from ludus.errors import CheckpointError
from ludus.runs.checkpoint import read_checkpoint
from tests.campaign.rounds import Finding, Round, TrainerProcess

__all__ = ["check_all", "check_checkpoints", "check_ending", "check_nothing_left", "check_resumes"]

ERRORS = frozenset({2, 3, 4, 5})
"""Exit codes of errors that Ludus names."""
GONE_WITHIN_S = 30.0


def check_all(the_round: Round, **settings: Any) -> None:
    """Check every promise, at the end of a round; the run resumes with other ``settings``."""
    check_checkpoints(the_round)
    check_resumes(the_round, **settings)
    check_nothing_left(the_round)
    check_nothing_ran(the_round)


def check_ending(trainer: TrainerProcess, *codes: int) -> None:
    """An end is a success, a signal of ours or an error with a name: never a defect or a hang."""
    code, text = trainer.wait(), trainer.text()
    allowed = {0, *(codes or ERRORS)}
    if code not in allowed or "this is a defect" in text or "Traceback" in text:
        raise Finding(f"a trainer ended with exit code {code}:\n{text}")


def check_checkpoints(the_round: Round) -> None:
    """Each checkpoint that was reported as saved loads, or is damaged and said to be so."""
    folder = the_round.run / "checkpoints"
    for path in sorted([*folder.glob("step-*"), *folder.glob("update-*")]):
        is_damaged = any(path in file.parents for file in the_round.damaged)
        try:
            checkpoint = read_checkpoint(path, has_replay=True)
        except CheckpointError as error:
            if not is_damaged or path.name not in error.message:
                raise Finding(f"{path.name} does not load: {error.message}") from error
            continue
        if is_damaged and not _is_intact(the_round, path):
            raise Finding(f"{path.name} was changed, and loads as if it were whole")
        if path.name.startswith("step-") and checkpoint.agent_steps != int(path.name[5:]):
            raise Finding(f"{path.name} holds {checkpoint.agent_steps} steps")
    for path in the_round.saved():
        if not path.exists() and not _may_be_gone(the_round, path):
            raise Finding(f"{path.name} was reported as saved, and is not there")


def _is_intact(the_round: Round, path: Path) -> bool:
    """Whether only files of a damaged checkpoint were changed that it does not need."""
    return not any((path / file.name) == file for file in the_round.damaged)


def _may_be_gone(the_round: Round, path: Path) -> bool:
    """Whether a checkpoint was dropped for newer ones, or set aside because it is damaged."""
    if any(path in file.parents for file in the_round.damaged):
        return bool(list(path.parent.glob(f"unloadable-{path.name}*")))
    newer = [other for other in path.parent.glob("step-*") if other.name > path.name]
    aside = path.parent.glob("unloadable-step-*")
    return path.name.startswith("step-") and (
        len(newer) + len(list(aside)) >= the_round.settings["keep_checkpoints"]
    )


def check_resumes(the_round: Round, **settings: Any) -> None:
    """The run resumes and ends. One without any checkpoint says so; then a new run ends."""
    settings = {"total_steps": _little_more(the_round), **settings}
    trainer = the_round.finish(resume=True, **settings)
    if trainer.wait() != 0:
        check_ending(trainer)
        whole = [path for path in the_round.saved() if path.exists()]
        if whole and not _names_damage(the_round, trainer.text()):
            raise Finding(f"the run does not resume:\n{trainer.text()}")
        _make_good(the_round)
        if not whole:
            the_round.run = the_round.run.with_name("another")
        settings["total_steps"] = _little_more(the_round)
        trainer = the_round.finish(resume=bool(whole), **settings)
    check_ending(trainer, 0)
    result = json.loads((the_round.run / "result.json").read_bytes())
    if result["stop_reason"] != "total_steps":
        raise Finding(f"the run ended for another reason: {result}")


def _little_more(the_round: Round) -> int:
    """Return a number of steps that no trainer of the round has reached."""
    steps = [path.name[5:] for path in the_round.saved() if path.name.startswith("step-")]
    return 64 + max(map(int, steps), default=0)


def _names_damage(the_round: Round, text: str) -> bool:
    joined = "".join(text.split())  # errors are wrapped to the width of the terminal
    return any(file.name in joined or file.parent.name in joined for file in the_round.damaged)


def _make_good(the_round: Round) -> None:
    """Bring back the damaged files as they were."""
    for file in the_round.damaged:
        backup = the_round.folder / "whole" / file.relative_to(the_round.run)
        if file.is_dir():
            file.rmdir()
        if file.parent.is_dir() and backup.exists():
            file.write_bytes(backup.read_bytes())
    the_round.damaged.clear()


def check_nothing_left(the_round: Round) -> None:
    """No process and no temporary file is left."""
    deadline = time.monotonic() + GONE_WITHIN_S
    while pids := the_round.processes():
        if time.monotonic() > deadline:
            names = [Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ") for pid in pids]
            raise Finding(f"processes are left: {names}")
        time.sleep(0.02)
    left = [path.name for path in the_round.temporary.glob("ludus*")]
    left += [str(path) for path in the_round.run.rglob(".*") if path.name != ".lock"]
    if left:
        raise Finding(f"temporary files are left: {left}")


def check_nothing_ran(the_round: Round) -> None:
    """Nothing ran that the user did not name."""
    if the_round.canary_list.exists():
        raise Finding(f"programs of the folder ran: {the_round.canary_list.read_text()}")
