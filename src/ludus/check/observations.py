"""Observations, rewards and ends of episodes under random play."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ludus.check.context import CheckContext
from ludus.check.finding import Finding, fail, info, ok, warn
from ludus.check.recording import Recording
from ludus.spec import ObservationEntry, PolicySpec

__all__ = ["check_observations"]

LARGE = 10.0
LARGE_QUANTILE = 0.99
MAX_LISTED = 64


def check_observations(context: CheckContext) -> list[Finding]:
    """Report on every entry, on rewards and on the ends of episodes."""
    recording = context.recording
    findings: list[Finding] = []
    for policy in recording.spec.policies:
        for entry in policy.observation:
            findings += _entry(recording, policy, entry)
        findings += [_reward(recording, policy), _ends(recording, policy)]
    return findings


def _entry(recording: Recording, policy: PolicySpec, entry: ObservationEntry) -> list[Finding]:
    batches = [frame.batches[policy.name] for frame in recording.frames]
    arrays = [batch.observation[entry.name][batch.active] for batch in batches]
    arrays += [batch.final_observation[entry.name] for batch in batches]
    values = np.concatenate(arrays).reshape(-1, entry.size).astype(np.float64)
    name = f"{policy.name}.{entry.name}"
    low, high = values.min(axis=0), values.max(axis=0)
    data: dict[str, Any] = {}
    if entry.size <= MAX_LISTED:
        figures = {"min": low, "max": high, "mean": values.mean(axis=0), "std": values.std(axis=0)}
        data = {name: figure.tolist() for name, figure in figures.items()}
    shape = "×".join(map(str, entry.shape))
    title = f"{name}: {shape} {entry.dtype}, {low.min():.4g} to {high.max():.4g}"
    findings = [ok(title, **data)]
    findings += _out_of_bounds(name, entry, low, high)
    constant = np.flatnonzero(low == high)
    if len(constant) and len(values) > 1:
        same = f": always {low[constant[0]]:.6g}" if len(constant) == 1 else ""
        if len(constant) == entry.size:
            which = "all elements" if entry.size > 1 else "the value"
            hint = "check how it is computed; for a sensor, its group, mask and reach"
        else:
            which = f"element{'s' * (len(constant) > 1)} {ranges(constant)}"
            hint = "leave them out; those of a sensor may stay, such as a count that is always full"
        findings.append(
            warn(
                f"{name}: constant elements",
                f"{which} never changed in {recording.num_steps} steps{same}",
                hint,
                elements=constant.tolist(),
            )
        )
    return [*findings, *_large(name, entry, values)]


def _out_of_bounds(
    name: str, entry: ObservationEntry, low: NDArray[np.float64], high: NDArray[np.float64]
) -> list[Finding]:
    bounds_low, bounds_high = (bound.reshape(-1).astype(np.float64) for bound in entry.bounds())
    wrong = np.flatnonzero((low < bounds_low) | (high > bounds_high))
    if not len(wrong):
        return []
    first = int(wrong[0])
    return [
        fail(
            f"{name}: out of bounds",
            f"elements {ranges(wrong)}; element {first} went from {low[first]:.6g} to "
            f"{high[first]:.6g}, declared {bounds_low[first]:.6g} to {bounds_high[first]:.6g}",
            "widen low and high of the LudusObservationEntry, or clamp the value",
            elements=wrong.tolist(),
        )
    ]


def _large(name: str, entry: ObservationEntry, values: NDArray[np.float64]) -> list[Finding]:
    if entry.dtype != "float32":
        return []
    low, high = (np.isfinite(bound).reshape(-1) for bound in entry.bounds())
    typical = np.quantile(np.abs(values), LARGE_QUANTILE, axis=0)
    large = np.flatnonzero((typical > LARGE) & ~(low & high))
    if not len(large):
        return []
    worst = int(large[typical[large].argmax()])
    return [
        warn(
            f"{name}: neither bounded nor near 1",
            f"elements {ranges(large)}; element {worst} typically reaches {typical[worst]:.4g}",
            "divide by a typical size in get_observation(), or train with normalise_observation on",
            elements=large.tolist(),
        )
    ]


def _reward(recording: Recording, policy: PolicySpec) -> Finding:
    name = f"{policy.name}: reward"
    batches = [frame.batches[policy.name] for frame in recording.frames]
    rewards = np.concatenate([now.reward[last.active] for last, now in pairwise(batches)])
    if not len(rewards):
        return warn(name, "no agent acted")
    low, high = float(rewards.min()), float(rewards.max())
    if low == high == 0.0:
        hint = "reward progress towards the goal, or make the goal reachable by chance"
        return warn(name, "random play never received a reward other than 0", hint)
    if low != high:
        mean = float(rewards.mean())
        return ok(name, f"{low:.4g} to {high:.4g}, mean {mean:.4g}", min=low, max=high, mean=mean)
    if _count(recording, policy, "terminated"):
        detail = f"always {low:.4g}: only the length of an episode matters"
        return ok(name, detail, min=low, max=high, mean=low)
    return warn(
        name,
        f"always {low:.4g}, and no episode was terminated: there is nothing to learn from",
        "reward what the agent should do, or terminate the episode when it fails",
    )


def _ends(recording: Recording, policy: PolicySpec) -> Finding:
    title = f"{policy.name}: episodes end"
    num_terminated = _count(recording, policy, "terminated")
    num_truncated = _count(recording, policy, "truncated")
    counts = {"num_terminated": num_terminated, "num_truncated": num_truncated}
    if num_terminated + num_truncated:
        return ok(title, f"{num_terminated} terminated, {num_truncated} truncated", **counts)
    limit = policy.max_episode_steps
    if limit is not None and limit > recording.num_steps:
        return info(
            title,
            f"none did within {recording.num_steps} steps; they are truncated after {limit}",
            f"run with --steps {limit + 1} to see an end",
            **counts,
        )
    return warn(
        title,
        f"no episode ended within {recording.num_steps} steps",
        "set LudusAgent.max_episode_steps, or return true from is_done() at the goal",
        **counts,
    )


def _count(
    recording: Recording, policy: PolicySpec, flag: Literal["terminated", "truncated"]
) -> int:
    return sum(int(getattr(frame.batches[policy.name], flag).sum()) for frame in recording.frames)


def ranges(indices: Iterable[int]) -> str:
    """Return ascending integers in short form: ``0–3, 7``."""
    runs: list[list[int]] = []
    for index in map(int, indices):
        if runs and index == runs[-1][1] + 1:
            runs[-1][1] = index
        else:
            runs.append([index, index])
    return ", ".join(str(a) if a == b else f"{a}–{b}" for a, b in runs)
