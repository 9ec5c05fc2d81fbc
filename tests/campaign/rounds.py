"""A round of the campaign: its folder, its chances, and the trainers that it starts."""

from __future__ import annotations

import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from tests.campaign.processes import kill_all, marked_processes
from tests.campaign.trainer import be_trainer

__all__ = ["Finding", "Round", "TrainerProcess"]

DEADLINE_S = 180.0
"""No run of a campaign is to take so long, even on a busy machine at low priority."""

# Programs and modules that a command might take from the folder it is started in.
CANARIES = ("_winapi", "nt", "dill", "pynvml", "sitecustomize", "usercustomize", "orjson", "jax",
            "tensorflow", "godot", "godot3", "cargo", "git", "xvfb-run", "nvidia-smi")  # fmt: skip


class Finding(Exception):  # noqa: N818 - what a campaign is for
    """A promise that was broken."""


class TrainerProcess:
    """A trainer that runs.

    Attributes:
        pid: Of the process.
        output: File of what it prints.
    """

    def __init__(self, pid: int, output: Path) -> None:
        self.pid = pid
        self.output = output
        self._code: int | None = None
        self._deadline = time.monotonic() + DEADLINE_S

    def poll(self) -> int | None:
        """Return the exit code, negative for a signal; None while it runs.

        Raises:
            Finding: It hangs.
        """
        if self._code is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                self._code = os.waitstatus_to_exitcode(status)
            elif time.monotonic() > self._deadline:
                self.signal(signal.SIGKILL)
                os.waitpid(self.pid, 0)
                self._code = -signal.SIGKILL
                raise Finding(f"hung for {DEADLINE_S:g} s:\n{self.text()}")
        return self._code

    def wait(self, timeout_s: float = 2 * DEADLINE_S) -> int | None:
        """Wait for the end and return the exit code; None if it still runs."""
        end = time.monotonic() + timeout_s
        while (code := self.poll()) is None and time.monotonic() < end:
            time.sleep(0.005)
        return code

    def signal(self, number: int) -> None:
        """Send a signal, unless it has ended."""
        if self._code is None:
            os.kill(self.pid, number)

    def text(self) -> str:
        """Return what it has printed."""
        return self.output.read_text(errors="replace") if self.output.exists() else ""


class Round:
    """One round.

    Attributes:
        name: Seed and number, which replay it.
        chance: Every decision of the round comes from here.
        engine: What the trainers train in: ``gym``, ``godot4``, ``godot3`` or ``bevy``.
        folder: All that the round writes; trainers start in it.
        decisions: What was decided, in words.
        counts: What happened: ``kills``, ``frames`` and so on.
        damaged: Files that a fault has changed.
    """

    def __init__(self, seed: int, number: int, targets: Mapping[str, str], parent: Path) -> None:
        self.name = f"{seed}/{number}"
        self.chance = random.Random(self.name)
        self._targets = targets
        self.engine = "gym"
        self.decisions: list[str] = []
        self.counts: Counter[str] = Counter()
        self.damaged: set[Path] = set()
        self.folder = parent / f"round-{seed}-{number}"
        self.temporary = self.folder / "tmp"
        self.saved_list = self.folder / "saved.txt"
        self.canary_list = self.folder / "canaries.txt"
        self.run = self.folder / "runs" / "run"
        self._num_trainers = 0
        self._plant()
        self.settings = self._draw_settings()

    def _plant(self) -> None:
        """Make the folder, with programs and modules in it that nobody may run."""
        shutil.rmtree(self.folder, ignore_errors=True)
        self.temporary.mkdir(parents=True)
        for name in CANARIES:
            text = f"open({str(self.canary_list)!r}, 'a').write({name!r} + ' ')\n"
            (self.folder / f"{name}.py").write_text(text)
            program = self.folder / name
            program.write_text(f"#!{sys.executable}\n{text}")
            program.chmod(0o755)

    def _draw_settings(self) -> dict[str, Any]:
        """Draw the settings of a run of about ten updates, each with a checkpoint."""
        chance = self.chance
        algorithm = chance.choice(["ppo", "ppo", "sac"])
        tiny = {"hidden_sizes": (8,)}
        ppo = {"rollout_steps": 8, **tiny}
        sac = {"batch_size": 8, "replay_capacity": 256, "learning_starts": 16,
               "report_steps": 16, "updates_per_step": 0.25, **tiny}  # fmt: skip
        return {
            "num_worlds": 2,
            "num_engines": 1,
            "total_steps": chance.choice([96, 160, 224]),
            "checkpoint_every_updates": 1,
            "checkpoint_every_s": None,
            "keep_checkpoints": chance.choice([1, 2, 1000]),
            "keep_every_updates": chance.choice([None, 2]),
            "evaluation_episodes": chance.choice([0, 0, 1]),
            "seed": chance.randrange(1 << 31),
            "algorithm": algorithm,
            algorithm: ppo if algorithm == "ppo" else sac,
        }

    def decide(self, text: str) -> None:
        """Note a decision; a failure shows them all."""
        self.decisions.append(text)

    def choose_engine(self, *engines: str) -> None:
        """Draw one of these engines, of those that are there."""
        self.engine = self.chance.choice([name for name in engines if name in self._targets])
        self.decide(f"engine {self.engine}")

    def begin(
        self, *, resume: bool = False, before: Callable[[], None] | None = None, **settings: Any
    ) -> TrainerProcess:
        """Start a trainer on :attr:`run`.

        Args:
            resume: Go on with the run; the settings are laid over the saved ones.
            before: Called in the trainer before it trains; plants faults there.
            settings: Over :attr:`settings`.
        """
        given = settings if resume else {**self.settings, **settings}
        if not resume:
            given = {"target": self._targets[self.engine], "name": self.run.name,
                     "runs": str(self.run.parent), **given}  # fmt: skip
        self._num_trainers += 1
        output = self.folder / f"output-{self._num_trainers}.txt"
        sys.stdout.flush()
        sys.stderr.flush()
        pid = os.fork()
        if pid == 0:
            be_trainer(self, given, self.run if resume else None, output, before)
        return TrainerProcess(pid, output)

    def finish(self, *, resume: bool = False, **settings: Any) -> TrainerProcess:
        """Start a trainer and wait for its end."""
        trainer = self.begin(resume=resume, **settings)
        trainer.wait()
        return trainer

    def saved(self) -> list[Path]:
        """Return the checkpoints that trainers have reported as saved, oldest first."""
        if not self.saved_list.exists():
            return []
        lines = self.saved_list.read_text(errors="surrogateescape").splitlines()
        paths = dict.fromkeys(self.folder / line for line in lines)
        return [path for path in paths if self.run in path.parents]

    def processes(self) -> list[int]:
        """Return the ids of processes that the round's trainers have started and that run."""
        return marked_processes(str(self.folder))

    def close(self, *, keep: bool) -> None:
        """End what is left; remove the folder unless it is to be looked at."""
        kill_all(self.processes())
        if not keep:
            shutil.rmtree(self.folder, ignore_errors=True)


def campaign_folder() -> Path:
    """Return a new folder for the rounds of a campaign."""
    return Path(tempfile.mkdtemp(prefix="campaign-"))


def pick(items: Sequence[Any], share: float) -> Any:
    """Return the item that lies at ``share`` of a sequence: a decision made before it was known."""
    return items[min(int(share * len(items)), len(items) - 1)]
