"""Take over from a run what it was trained with: settings, checkpoint, policies."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, cast

import torch
from torch import Tensor, nn

from ludus.errors import CheckpointError
from ludus.networks.normalise import MIN_VARIANCE
from ludus.networks.own_network import PREFIX, MakeNetwork
from ludus.networks.policy import Policy
from ludus.networks.tensors import load_tensors, with_prefix
from ludus.runs.checkpoint import Checkpoint, check_spec, checkpoint_errors, read_checkpoint
from ludus.runs.run_folder import RunFolder
from ludus.runs.trust import PROGRAM_SETTINGS, require_trust
from ludus.settings.plain import saved_policy, to_plain
from ludus.settings.policy_config import PolicyConfig, PPOConfig
from ludus.settings.train_config import TrainConfig
from ludus.spec import PolicySpec

__all__ = ["find_checkpoint", "load_policies", "trained_config"]


def trained_config(
    run: Path, uses: Collection[str] = PROGRAM_SETTINGS, **changes: Any
) -> TrainConfig:
    """Return the settings that a run was trained with, to start what they name.

    Args:
        run: A run folder, or one of its checkpoints.
        uses: Which of the settings that name programs are used.
        changes: Settings to take instead, where they are not None.

    Raises:
        CheckpointError: There is no such run.
        UsageError: Ludus did not make the run, and nobody has allowed its programs.
    """
    given = {name: value for name, value in changes.items() if value is not None}
    folder = RunFolder.find(run)
    config = folder.read_config()
    plain = to_plain(config)
    require_trust(
        folder.path / "config.json", {name: plain[name] for name in uses if name not in given}
    )
    return replace(config, **given)


def load_policies(
    run: Path | str,
    policies: Mapping[str, PolicySpec],
    networks: Mapping[str, MakeNetwork] | None = None,
) -> dict[str, Policy]:
    """Return trained policies by name.

    Args:
        run: A run folder, whose newest checkpoint is taken, or one of its checkpoints.
        policies: What the game declares; ``pool.policies``.
        networks: What the run was trained with in the place of Ludus's networks.

    Raises:
        CheckpointError: There is no such run, no checkpoint can be loaded, or it was trained for
            other observations or actions.
    """
    path, checkpoint = find_checkpoint(Path(run))
    check_spec(checkpoint, policies, path)
    makers = networks or {}
    return {
        name: _load(checkpoint, spec, makers.get(name), path) for name, spec in policies.items()
    }


def find_checkpoint(run: Path, choice: str = "newest") -> tuple[Path, Checkpoint]:
    """Return a checkpoint and where it is.

    Args:
        run: A run folder, or one of its checkpoints, which is taken unless ``choice`` is ``best``.
        choice: ``newest``, ``best`` (the highest mean return), or the path of a checkpoint, which
            may be its mere name in the run.

    Raises:
        CheckpointError: There is no such run or checkpoint, or it is corrupt.
    """
    folder = RunFolder.find(run)
    store = folder.checkpoints()
    if choice == "best":
        best = store.best()
        if best is None:
            raise CheckpointError(
                f"no checkpoint of {folder.path} has a mean return yet",
                "no episode had ended when they were saved; leave --checkpoint out",
            )
        return best, read_checkpoint(best)
    if choice != "newest":
        named = store.folder / choice
        path = named if named.is_dir() else Path(choice)
        return path, read_checkpoint(path)
    if run.resolve() != folder.path.resolve():
        return run, read_checkpoint(run)
    return store.newest()


def _load(
    checkpoint: Checkpoint, spec: PolicySpec, make_network: MakeNetwork | None, path: Path
) -> Policy:
    name = spec.name
    with checkpoint_errors(path):
        tensors = checkpoint.learners[name].tensors
        settings = saved_policy(checkpoint.config["policies"][name], f"policies.{name}")
    has_own = any(tensor.startswith(f"policy.{PREFIX}") for tensor in tensors)
    if has_own and make_network is None:
        raise CheckpointError(
            f"{path}: policy {name} has a network that a script made, which no file holds",
            f'in Python, networks={{"{name}": …}} says how it is made; an .onnx file of it runs '
            "without that (docs/python.md)",
        )
    # New networks draw their first weights from the stream that a run draws from meanwhile.
    with cast(Any, torch.random).fork_rng(devices=[]):
        policy = Policy(spec, settings, make_network if has_own else None)
        load_tensors(policy, tensors, "policy.")
        policy.critic = _load_critic(policy, tensors, settings)
    return policy.eval()


def _load_critic(
    policy: Policy, tensors: Mapping[str, Tensor], settings: PolicyConfig
) -> Callable[[Tensor], float] | None:
    """Return PPO's critic in the game's own rewards; None where the checkpoint has none."""
    if not isinstance(settings, PPOConfig) or not with_prefix(tensors, "critic."):
        return None
    network = policy.make_critic(settings)
    load_tensors(network, tensors, "critic.")
    scale = 1.0
    if settings.scale_reward:
        variance = tensors["scaler.statistics.variance"].clamp(min=MIN_VARIANCE)
        scale = float(variance.sqrt())
    return partial(_expected_return, network, scale)


def _expected_return(network: nn.Module, scale: float, features: Tensor) -> float:
    return float(network(features)) * scale
