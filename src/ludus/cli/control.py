"""``ludus control``: ask a running run for something."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from ludus.errors import RunError, UsageError, did_you_mean

if TYPE_CHECKING:
    from ludus.runs.control import Request
    from ludus.runs.run_folder import RunFolder

__all__ = ["COMMAND", "ControlCommand", "run"]

RUNS = Path("runs")
POLL_S = 0.05
USAGE = "such as: ludus control runs/tag-… chaser=frozen --save"


@dataclass(frozen=True)
class ControlCommand:
    """Switch the modes of policies in a running run, save a checkpoint, or stop it.

    Modes are train, frozen (acts as in training but learns nothing) and deterministic (takes the
    most probable actions and learns nothing). The trainer takes requests after every update.

    Attributes:
        changes: Run folder, then modes of policies, such as chaser=frozen. The folder may be left
            out if exactly one run in ./runs is running.
        save: Write a checkpoint now.
        stop: End training, with a checkpoint and the evaluation.
        timeout: Seconds to wait for the trainer to take the requests.
    """

    changes: Annotated[
        tyro.conf.Positional[tuple[str, ...]], tyro.conf.arg(metavar="[RUN] [POLICY=MODE ...]")
    ] = ()
    save: bool = False
    stop: bool = False
    timeout: float = 30.0


COMMAND = ControlCommand


def run(command: ControlCommand) -> int:
    """Send the requests and wait until they are taken; return 0.

    Raises:
        UsageError: There is nothing to change, or a policy or mode is unknown.
        CheckpointError: There is no such run.
        RunError: It is not running, has ended, or did not react.
    """
    from ludus.runs.control import SaveRequest, StopRequest
    from ludus.runs.run_folder import RunFolder

    folder, changes = _split_run(command.changes)
    if not changes and not command.save and not command.stop:
        raise UsageError("nothing to change", f"name a mode, --save or --stop, {USAGE}")
    found = _only_running() if folder is None else RunFolder.find(folder)
    requests: list[Request] = [*parse_changes(changes, found.read_config().policies)]
    requests += [SaveRequest()] * command.save + [StopRequest()] * command.stop
    if not found.is_running():
        raise RunError(
            f"the run {found.path} is not running",
            f"to continue it: ludus train --resume {found.path}; ludus runs lists all runs",
        )
    _send(found, requests, command.timeout)
    asked = ", ".join([*changes, *["save"] * command.save, *["stop"] * command.stop])
    sys.stdout.write(f"{found.path} accepted: {asked}\n")
    return 0


def parse_changes(changes: Sequence[str], policies: Collection[str]) -> list[Request]:
    """Return what ``policy=mode`` texts ask for.

    Raises:
        UsageError: A policy or mode is unknown, or a policy is named twice.
    """
    from ludus.runs.control import MODES, SetMode

    requests: list[Request] = []
    named: set[str] = set()
    for change in changes:
        policy, equals, mode = change.partition("=")
        if not equals:
            raise UsageError(f"cannot read the change {change!r}", f"write POLICY=MODE, {USAGE}")
        if policy not in policies:
            hint = did_you_mean(policy, policies, "policies of the run")
            raise UsageError(f"there is no policy {policy!r}", hint)
        if mode not in MODES:
            hint = did_you_mean(mode, MODES, "modes")
            raise UsageError(f"there is no mode {mode!r}", hint)
        if policy in named:
            raise UsageError(f"policy {policy} is named twice", "name one mode for each policy")
        named.add(policy)
        requests.append(SetMode(policy, mode))
    return requests


def _split_run(changes: Sequence[str]) -> tuple[Path | None, Sequence[str]]:
    """Return the run folder, None if none was named, and the rest."""
    if not changes or ("=" in changes[0] and not Path(changes[0]).is_dir()):
        return None, changes
    return Path(changes[0]), changes[1:]


def _only_running() -> RunFolder:
    from ludus.runs.run_list import running_runs

    found = running_runs(RUNS)
    if len(found) == 1:
        return found[0]
    if not found:
        raise UsageError(f"no run in {RUNS} is running", f"name the run folder, {USAGE}")
    names = ", ".join(str(run.path) for run in found)
    raise UsageError(f"several runs are running: {names}", f"name one, {USAGE}")


def _send(folder: RunFolder, requests: Sequence[Request], timeout_s: float) -> None:
    """Leave the requests and wait until all are taken; withdraw them if the run ends first."""
    from ludus.runs.control import send_request

    left = [send_request(folder.control, request) for request in requests]
    deadline = time.monotonic() + timeout_s
    while left := [path for path in left if path.exists()]:
        if not folder.is_running():
            if not (left := [path for path in left if path.exists()]):
                return  # taken just before it ended
            for path in left:
                with contextlib.suppress(OSError):
                    path.unlink()
            raise RunError(
                f"the run {folder.path} ended before it took the request",
                f"to continue it: ludus train --resume {folder.path}",
            )
        if time.monotonic() > deadline:
            raise RunError(
                f"the run {folder.path} did not react within {timeout_s:g} s",
                "it handles requests after its current update, but not during the evaluation; to "
                "wait longer: --timeout",
            )
        time.sleep(POLL_S)
