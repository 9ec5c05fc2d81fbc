"""Workers, games, nodes and the head of a Ray cluster: killed or stopped; and nodes that join."""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.campaign.processes import MARK
from tests.campaign.promises import check_all, check_ending
from tests.campaign.rounds import Finding, Round, TrainerProcess, pick

__all__ = ["harm_nodes"]

SILENCE_S, LOOK_S = 6.0, 1.0
"""In the place of 30 s and of Ludus's own pace, so that a round takes seconds."""
STARTS_WITHIN_S = 120.0


def harm_nodes(the_round: Round) -> None:
    """Train on two nodes and harm them, one after another; the run goes on, or ends with one error.

    It resumes on this machine, as everything of the cluster is gone then.
    """
    the_round.choose_engine("gym", "godot4")
    chance = the_round.chance
    harms = [
        (chance.uniform(0.0, 3.0), chance.random(), chance.choice(["kill", "stop", "node", "join"]))
        for _ in range(chance.randint(1, 3))
    ]
    kills_head = chance.random() < 0.3
    with Nodes(the_round) as nodes:
        trainer = the_round.begin(
            before=nodes.be_impatient, cluster=nodes.address, num_machines=2, total_steps=6000
        )
        _await_metrics(the_round, trainer)
        for delay_s, share, harm in harms:
            if trainer.wait(delay_s) is not None:
                break
            the_round.decide(f"{harm} {delay_s:.3f} s later")
            nodes.harm(harm, share)
        if kills_head and trainer.wait(0.5) is None:
            the_round.decide("kill the head")
            nodes.kill(0)
        check_ending(trainer, 5)
    check_all(the_round, cluster="local:2", num_machines=None)


class Nodes:
    """A head and two nodes on this machine, each in a process group of its own.

    Args:
        the_round: Their processes carry its mark.
    """

    def __init__(self, the_round: Round) -> None:
        self._the_round = the_round
        self._folder = tempfile.mkdtemp(prefix="ray-", dir="/tmp")  # paths of sockets must be short
        self._groups: list[int] = []
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = free.getsockname()[1]
        self.address = f"127.0.0.1:{port}"
        self._environment = {
            **os.environ, MARK: str(the_round.folder), "RAY_AUTH_MODE": "token",
            "RAY_AUTH_TOKEN": secrets.token_hex(16),
        }  # fmt: skip
        self._head = ("--head", f"--port={port}", "--num-cpus=0", "--include-dashboard=false")

    def __enter__(self) -> Nodes:
        try:
            self._start(*self._head, f"--temp-dir={self._folder}")
            self.join()
            self.join()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        for number in range(len(self._groups)):
            self.kill(number)
        shutil.rmtree(self._folder, ignore_errors=True)

    def be_impatient(self) -> None:
        """Let the trainer into the cluster, and not wait for long."""
        os.environ.update(self._environment)  # before Ray is loaded, which reads it once
        from ludus.workers import nodes, ray_machines

        ray_machines.SILENCE_S = SILENCE_S
        ray_machines.LOOK_S = nodes.LOOK_S = LOOK_S

    def harm(self, what: str, share: float) -> None:
        """Kill or stop a worker or a game, kill a node that is not the head, or let one join."""
        if what == "join":
            self.join()
        elif what == "node":
            self.kill(1 + int(share * (len(self._groups) - 1)))
        elif found := [pid for pid in self._the_round.processes() if _is_played(pid)]:
            with contextlib.suppress(ProcessLookupError):  # it has just ended
                os.kill(pick(found, share), signal.SIGKILL if what == "kill" else signal.SIGSTOP)
        self._the_round.counts[f"{what}s of a cluster"] += 1

    def join(self) -> None:
        """Add a node."""
        self._start(f"--address={self.address}", "--num-cpus=2")

    def kill(self, number: int) -> None:
        """End all processes of a node, of which the head is the first."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._groups[number], signal.SIGKILL)

    def _start(self, *flags: str) -> None:
        command = [Path(sys.executable).with_name("ray"), "start", "--disable-usage-stats", *flags]
        with subprocess.Popen(
            command, env=self._environment, start_new_session=True, stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        ) as starting:  # fmt: skip
            self._groups.append(starting.pid)
            if starting.wait(STARTS_WITHIN_S) != 0:
                raise RuntimeError(f"ray start {' '.join(flags)} failed")


def _await_metrics(the_round: Round, trainer: TrainerProcess) -> None:
    metrics = the_round.run / "metrics.jsonl"
    while not metrics.exists():
        if trainer.wait(0.1) is not None:
            raise Finding(f"no update was made:\n{trainer.text()}")


def _is_played(pid: int) -> bool:
    """Whether a process is a worker, or a game of one."""
    with contextlib.suppress(OSError):
        command = Path(f"/proc/{pid}/cmdline").read_bytes()
        return b"ray::_Actor" in command or b"--ludus-connect" in command
    return False
