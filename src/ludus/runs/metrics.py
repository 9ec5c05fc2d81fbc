"""What is measured while training: one JSON object per update, and the same for TensorBoard.

:data:`METRICS` documents every one. In ``metrics.jsonl`` those of a policy stand under
``policies.<name>``, what the game reports under ``game.<name>``, and means of drawn parameters of
worlds under ``parameters``; TensorBoard and the trackers
of :mod:`ludus.runs.tracking` call them ``<name>/<metric>`` and ``game/<name>/<metric>``.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import logging
import socket
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tensorboard.summary.writer.record_writer import RecordWriter

from ludus.disk import disk_errors, plain_file_opener, read_plain_file, write_atomically
from ludus.errors import RunError
from ludus.runs.run_list import parse_metrics
from ludus.runs.tracking import Tracker

__all__ = ["METRICS", "POLICY_METRICS", "MetricsLog", "read_metrics"]

log = logging.getLogger(__name__)

# Generated modules, which have no types.
_events: Any = importlib.import_module("tensorboard.compat.proto.event_pb2")
_summaries: Any = importlib.import_module("tensorboard.compat.proto.summary_pb2")

METRICS: dict[str, str] = {
    "agent_steps": "Agent steps so far: decisions of active agents, without those of past selves.",
    "updates": "Updates so far: rounds of collecting, after each of which some policy has learnt.",
    "wall_s": "Seconds of training so far, over all resumptions; without start and evaluation.",
    "steps_per_s": "Agent steps per second since the last update, learning included.",
    "wait_share": "Share of that time spent waiting for engines.",
    "act_share": "Share of that time spent choosing and sending actions.",
    "record_share": "Share of that time spent recording outcomes.",
    "update_share": "Share of that time spent learning, between steps or while engines simulated.",
    "restarts": "Engines restarted so far, after a crash or a missed deadline.",
    "lesson": "Number of the lesson, from 1; always 1 without a curriculum.",
}
"""Metrics of a run."""

POLICY_METRICS: dict[str, str] = {
    "mean_return": "Mean undiscounted return of the last return_window episodes.",
    "min_return": "Lowest of them.",
    "max_return": "Highest of them.",
    "return_p10": "Their 10th percentile.",
    "return_p90": "Their 90th percentile.",
    "mean_length": "Mean agent steps of the last return_window episodes.",
    "episodes": "Episodes that ended so far.",
    "is_learning": "1 in mode train, 0 in frozen and deterministic.",
    "elo": "Rating of the policy as it is now; with self-play only.",
    "policy_loss": "PPO: clipped surrogate objective with the sign turned, equation 7. SAC: soft "
    "value of the policy with the sign turned, equation 7 of its paper.",
    "value_loss": "PPO: half the mean squared error of the value, in units of scaled rewards.",
    "entropy": "Mean entropy of the action distribution, nats.",
    "approximate_kl": "PPO: divergence from the policy that collected, nats; estimator k3.",
    "clip_fraction": "PPO: share of transitions whose ratio left the clip range.",
    "grad_norm": "PPO: length of the gradient before it is shortened.",
    "explained_variance": "PPO: 1 - Var(target - value) / Var(target); 1 is a perfect critic.",
    "num_epochs": "PPO: passes over the rollout; fewer than epochs where target_kl stopped them.",
    "num_transitions": "PPO: transitions learnt from; those of inactive slots are left out.",
    "has_reward": "PPO: 1 once a reward other than 0 was seen; the actor waits for it.",
    "novelty": "PPO with curiosity: mean error of what predicts features of observations.",
    "learning_rate": "Step size of the optimiser in this update.",
    "action_std": "PPO: mean standard deviation of continuous actions, whose bounds are -1 and 1.",
    "imitation_weight": "PPO: weight of the demonstrations' loss; with imitate only.",
    "imitation_loss": "PPO: mean negative log-probability of demonstrated actions, nats; with "
    "imitate only, until its weight is negligible.",
    "q_loss": "SAC: half the mean squared error of both critics in sum, equation 5.",
    "mean_q": "SAC: mean value of the actions in the replay, by the first critic.",
    "temperature": "SAC: weight of the entropy, alpha.",
    "temperature_loss": "SAC: log(alpha) times the entropy above target_entropy, equation 18.",
    "gradient_steps": "SAC: gradient steps so far.",
    "replay_size": "SAC: transitions in the replay.",
}
"""Metrics of a policy, those of one algorithm alone marked.

Losses are means over the minibatches of the last epoch (PPO), or over the gradient steps since the
last update (SAC)."""


class MetricsLog:
    """Writes metrics to ``metrics.jsonl``, to an event file for TensorBoard, and to trackers.

    On a resumed run, call :meth:`forget_after` first.
    """

    def __init__(self, folder: Path, first_step: int = 0, trackers: Sequence[Tracker] = ()) -> None:
        self._trackers = trackers
        self._path = folder / "metrics.jsonl"
        with disk_errors(str(self._path)):
            self._lines = open(self._path, "ab", opener=plain_file_opener)  # noqa: SIM115
        self._events = _EventFile(folder, first_step)

    @staticmethod
    def forget_after(path: Path, agent_steps: int) -> None:
        """Drop the lines that were written after the checkpoint a run resumes from."""
        if not path.exists():
            return
        kept = [line for line in read_metrics(path) if line["agent_steps"] <= agent_steps]
        text = "".join(json.dumps(line) + "\n" for line in kept)
        with disk_errors(str(path)):
            write_atomically(path, text.encode())

    def write(
        self,
        metrics: Mapping[str, float],
        policies: Mapping[str, Mapping[str, float]],
        game: Mapping[str, Mapping[str, float]] | None = None,
        parameters: Mapping[str, float] | None = None,
    ) -> None:
        """Write one update's metrics; ``metrics["agent_steps"]`` is the x axis.

        Args:
            metrics: Of the run.
            policies: Of each policy.
            game: Of each name that the game has reported.
            parameters: Mean of each parameter of worlds that was drawn.
        """
        values = {**metrics, "policies": policies} | ({"game": game} if game else {})
        values |= {"parameters": parameters} if parameters else {}
        line = json.dumps(values) + "\n"
        with disk_errors(str(self._path)):
            self._lines.write(line.encode())
            self._lines.flush()
        scalars = {f"run/{name}": value for name, value in metrics.items()}
        for policy, values in policies.items():
            scalars |= {f"{policy}/{name}": value for name, value in values.items()}
        for name, own in (game or {}).items():
            scalars |= {f"game/{name}/{key}": value for key, value in own.items()}
        scalars |= {f"parameters/{name}": value for name, value in (parameters or {}).items()}
        step = int(metrics["agent_steps"])
        self._events.write(step, scalars)
        for tracker in self._trackers:
            tracker.write(step, scalars)

    def close(self) -> None:
        """Close both files and all trackers."""
        with contextlib.ExitStack() as stack:
            stack.callback(self._events.close)
            for tracker in self._trackers:
                stack.callback(tracker.close)
            with disk_errors(str(self._path)):
                self._lines.close()


class _EventFile:
    """A new event file in a run folder; what goes wrong when writing is raised at once.

    ``tensorboard --logdir runs`` joins the files of a run; what older ones hold beyond
    ``first_step`` is dropped, as the run was resumed from there.
    """

    def __init__(self, folder: Path, first_step: int) -> None:
        name = f"events.out.tfevents.{time.time():.0f}.{socket.gethostname()}.{time.time_ns()}"
        self._folder = folder
        with disk_errors(f"the TensorBoard log in {folder}"):
            self._file = (folder / name).open("wb")
        self._records: Any = RecordWriter(self._file)
        self._write(_events.Event(wall_time=time.time(), file_version="brain.Event:2"))
        start = _events.SessionLog(status=_events.SessionLog.START)
        # TensorBoard drops the points of older files from this step on; that of ``first_step``
        # itself is the last one before the resumption.
        step = first_step + 1
        self._write(_events.Event(wall_time=time.time(), step=step, session_log=start))

    def write(self, step: int, scalars: Mapping[str, float]) -> None:
        """Write scalars by tag."""
        values = [_summaries.Summary.Value(tag=k, simple_value=v) for k, v in scalars.items()]
        summary = _summaries.Summary(value=values)
        self._write(_events.Event(wall_time=time.time(), step=step, summary=summary))

    def close(self) -> None:
        """Close the file."""
        with disk_errors(f"the TensorBoard log in {self._folder}"):
            self._file.close()

    def _write(self, event: Any) -> None:
        with disk_errors(f"the TensorBoard log in {self._folder}"):
            self._records.write(event.SerializeToString())
            self._file.flush()


def read_metrics(path: Path) -> list[dict[str, Any]]:
    """Return the lines of a ``metrics.jsonl``.

    Other lines are left out, with a warning unless it is the last one, cut short by a kill.

    Raises:
        RunError: The file cannot be read.
    """
    try:
        texts = read_plain_file(path).splitlines()
    except OSError as error:
        raise RunError(f"cannot read {path}: {error.strerror}") from None
    lines = [parse_metrics(text) for text in texts]
    if None in lines[:-1]:
        log.warning("%s: %d lines are damaged and left out", path, lines.count(None))
    return [line for line in lines if line is not None]
