"""Load the policies of a run, to evaluate, play or export them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ludus.networks.policy import Policy
from ludus.networks.tensors import load_tensors
from ludus.runs.checkpoint import Checkpoint, check_spec, read_checkpoint
from ludus.runs.run_folder import RunFolder
from ludus.settings.merging import saved_policy
from ludus.spec import PolicySpec

__all__ = ["load_policies"]


def load_policies(run: Path, policies: Mapping[str, PolicySpec]) -> dict[str, Policy]:
    """Return trained policies by name.

    Args:
        run: A run folder, whose newest checkpoint is taken, or one of its checkpoints.
        policies: What the game declares; ``pool.policies``.

    Raises:
        CheckpointError: There is no such run, no checkpoint can be loaded, or it was trained for
            other observations or actions.
    """
    path, checkpoint = _find(run)
    check_spec(checkpoint.fingerprints, policies, path)
    return {name: _load(checkpoint, name, spec) for name, spec in policies.items()}


def _find(run: Path) -> tuple[Path, Checkpoint]:
    folder = RunFolder.find(run)
    if run.resolve() != folder.path.resolve():
        return run, read_checkpoint(run)
    return folder.checkpoints().newest()


def _load(checkpoint: Checkpoint, name: str, spec: PolicySpec) -> Policy:
    settings = saved_policy(checkpoint.config["policies"][name], f"policies.{name}")
    policy = Policy(spec, settings)
    load_tensors(policy, checkpoint.learners[name].tensors, "policy.")
    return policy.eval()
