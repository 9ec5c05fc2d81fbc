"""Policies with lively weights, and run folders that hold them, made without training."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any, cast

import torch
from torch import Tensor

from ludus.algorithms.learner import LearnerState
from ludus.networks.policy import Policy
from ludus.runs.checkpoint import Checkpoint
from ludus.runs.run_folder import RunFolder
from ludus.settings.plain import to_plain
from ludus.settings.train_config import PolicyConfig, PPOConfig, TrainConfig
from ludus.spec import (
    AgentSpec,
    ContinuousAction,
    DiscreteAction,
    ObservationEntry,
    PolicySpec,
)

SIMPLE = PolicySpec(
    name="hero",
    observation=(ObservationEntry("position", "float32", (3,)),),
    action=(DiscreteAction("move", 4),),
    agents=(AgentSpec(0, None),),
)
MIXED = PolicySpec(
    name="mixed",
    observation=(
        ObservationEntry("rays", "float32", (4,), 0.0, 1.0),
        ObservationEntry("camera", "uint8", (2, 12, 14, 3), 0, 255),
        ObservationEntry("ammunition", "int64", (2,), 0, 5),
        ObservationEntry("flags", "uint8", (4,)),
    ),
    action=(
        DiscreteAction("jump", 3),
        ContinuousAction("aim", 2, -2.0, (5.0, 7.0)),
        DiscreteAction("fire", 2),
    ),
    agents=(AgentSpec(0, None),),
    has_action_mask=True,
)
SMALL = PPOConfig(hidden_sizes=(16, 8))


def make_policy(
    spec: PolicySpec, config: PolicyConfig = SMALL, seed: int = 0, noise: float = 0.05
) -> Policy:
    """Return a policy whose weights, biases and statistics are all away from their start."""
    cast(Any, torch).manual_seed(seed)
    policy = Policy(spec, config)
    with torch.no_grad():
        for parameter in policy.parameters():
            parameter.add_(noise * torch.randn_like(parameter))
        last = policy.actor[-1]
        for parameter in last.parameters():
            parameter.add_(0.3 * torch.randn_like(parameter))
    if policy.encoder.normaliser is not None and policy.encoder.vector_size:
        shape = (100, policy.encoder.vector_size)
        policy.encoder.normaliser.update(2.0 * torch.randn(shape) + torch.randn(shape[1]))
    return policy.eval()


def make_run(
    folder: Path,
    policies: dict[str, Policy],
    steps: dict[int, float | None] | None = None,
    samples: dict[str, Tensor] | None = None,
    config: PolicyConfig = SMALL,
) -> Path:
    """Return a run folder.

    Args:
        folder: Where.
        policies: By name.
        steps: Mean return of each checkpoint by its agent steps.
        samples: Recorded observations of every policy.
        config: Settings that all policies were made with.
    """
    folder.mkdir(parents=True)
    run = RunFolder(folder)
    trained = TrainConfig(target="nowhere", policies=dict.fromkeys(policies, config))
    run.write_config(trained)
    for agent_steps, mean_return in (steps or {100: 1.0}).items():
        learners = {
            name: LearnerState(_tensors(policy, agent_steps, samples), {"algorithm": "ppo"})
            for name, policy in policies.items()
        }
        specs = {name: dataclasses.replace(p.spec, name=name) for name, p in policies.items()}
        checkpoint = Checkpoint(
            agent_steps=agent_steps,
            mean_return=mean_return,
            learners=learners,
            specs={name: spec.to_json() for name, spec in specs.items()},
            fingerprints={name: spec.fingerprint() for name, spec in specs.items()},
            config=to_plain(trained),
            run={},
        )
        run.checkpoints(keep=100).write(checkpoint)
    return folder


def _tensors(policy: Policy, agent_steps: int, samples: dict[str, Tensor] | None) -> dict[str, Any]:
    """Return a learner's tensors; the last bias is the number of steps, to tell them apart."""
    state = {name: value.clone() for name, value in policy.state_dict().items()}
    last = next(name for name in reversed(state) if name.startswith("actor") and "bias" in name)
    state[last][0] = agent_steps / 1000.0
    tensors = {f"policy.{name}": value for name, value in state.items()}
    return tensors | {f"samples.{name}": value for name, value in (samples or {}).items()}
