"""Which device trains a policy faster: each plays and learns a little, from random observations."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch

from ludus.algorithms.learner import Learner
from ludus.settings.policy_config import PolicyConfig, PPOConfig
from ludus.spec import PolicySpec
from ludus.spec.batch import Batch

__all__ = ["faster_device", "for_a_trial", "seconds_per_update"]

_log = logging.getLogger(__name__)

NUM_TRIALS = 3
"""Timed rounds of each device, after one that warms it up; the quickest counts."""
_HOPELESS = 4.0
"""A CPU whose first round takes this many times as long as the GPU's best is tried no further."""


def faster_device(
    spec: PolicySpec, engine_rows: list[slice], make: Callable[[torch.device], Learner]
) -> torch.device:
    """Return the CPU or the GPU, whichever trains faster; the CPU where the GPU fails.

    Args:
        spec: The policy's.
        engine_rows: Slots of each engine.
        make: Makes a learner on a device, with the settings that :func:`for_a_trial` returns.
    """
    # The GPU first: where it is worth having, the processor need not finish its first round.
    gpu, cpu = torch.device("cuda"), torch.device("cpu")
    try:
        on_gpu = seconds_per_update(make(gpu), spec, engine_rows)
    except RuntimeError as error:  # too old for this PyTorch, or too little memory
        reason = str(error).partition("\n")[0]
        _log.warning("policy %s learns on the CPU, as the GPU fails: %s", spec.name, reason)
        return cpu
    on_cpu = seconds_per_update(make(cpu), spec, engine_rows, _HOPELESS * on_gpu)
    device = gpu if on_gpu < on_cpu else cpu
    _log.info(
        "policy %s learns on %s: %.1f ms a trial on the GPU, %.1f ms on the CPU",
        spec.name, device.type, on_gpu * 1e3, on_cpu * 1e3,
    )  # fmt: skip
    return device


def for_a_trial(config: PolicyConfig, num_agents: int) -> PolicyConfig:
    """Return settings with which a step costs the same, but an update comes sooner.

    Args:
        config: Those of the run.
        num_agents: Agents of all engines.
    """
    if isinstance(config, PPOConfig):
        fewest = math.ceil(config.minibatch_size / num_agents)
        length = min(config.sequence_length, config.rollout_steps) if config.memory_size else 1
        steps = min(config.rollout_steps, math.ceil(fewest / length) * length)
        return replace(config, rollout_steps=steps, overlap=False, target_kl=None)
    return replace(
        config,
        learning_starts=config.batch_size,
        replay_capacity=4 * max(config.batch_size, num_agents),
        report_steps=min(config.report_steps, 32),
    )


def seconds_per_update(
    learner: Learner,
    spec: PolicySpec,
    engine_rows: list[slice],
    limit_s: float = math.inf,
) -> float:
    """Return the seconds that a learner takes to play until its next update, and for the update.

    Args:
        learner: A new one.
        spec: Its policy's.
        engine_rows: Slots of each engine.
        limit_s: A first round that takes longer is broken off, and the time until then returned.
    """
    random = np.random.default_rng(0)
    batches = [_random_batch(spec, rows.stop - rows.start, random) for rows in engine_rows]
    for engine, batch in enumerate(batches):
        learner.begin(engine, batch)
    first = _play_and_learn(learner, batches, limit_s)
    if first > limit_s:
        return first
    return min(_play_and_learn(learner, batches, math.inf) for _ in range(NUM_TRIALS))


def _play_and_learn(learner: Learner, batches: list[Batch], limit_s: float) -> float:
    start = time.perf_counter()
    while learner.num_steps_left:
        for engine, batch in enumerate(batches):
            learner.act(engine)
            learner.learn_while_stepping()
            learner.record(engine, batch)
        if time.perf_counter() - start > limit_s:
            break
    else:
        learner.update(0.0)  # returns losses as numbers, so a GPU has finished
    return time.perf_counter() - start


def _random_batch(spec: PolicySpec, num_agents: int, random: np.random.Generator) -> Batch:
    batch = Batch.allocate(spec, num_agents)
    batch.active[:] = True
    batch.reward[:] = random.normal(size=num_agents)
    for array in batch.observation.values():
        is_real = array.dtype.kind == "f"
        array[:] = (
            random.normal(size=array.shape) if is_real else random.integers(2, size=array.shape)
        )
    return batch
