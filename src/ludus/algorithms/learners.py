"""Which learner trains a policy."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, cast

import numpy as np
import torch

from ludus.algorithms.device_trial import faster_device, for_a_trial
from ludus.algorithms.imitation import Cloning, Imitation, OnCloning
from ludus.algorithms.learner import Learner, LearnerSettings
from ludus.algorithms.ppo import PPO
from ludus.datasets import Demonstrations, read_demonstrations
from ludus.errors import ConfigError, UsageError
from ludus.networks.device import choose_device, uses_bfloat16
from ludus.networks.own_network import MakeNetwork
from ludus.networks.policy import Policy
from ludus.pool.interface import Pool
from ludus.settings.policy_config import PolicyConfig, PPOConfig
from ludus.settings.train_config import TrainConfig
from ludus.spec import PolicySpec

__all__ = ["MakeLearner", "OwnParts", "make_learners", "policy_seed"]

MakeLearner = Callable[[Policy, PolicyConfig, LearnerSettings], Learner]
"""Makes what trains a policy, from the policy, its settings, and what it has to know of the run."""


@dataclass(frozen=True)
class OwnParts:
    """Networks and algorithms that a script brings, by policy.

    Attributes:
        networks: Makers of torsos, see :class:`~ludus.networks.own_network.OwnTorso`.
        learners: Makers of learners.
    """

    networks: Mapping[str, MakeNetwork] = field(default_factory=dict[str, MakeNetwork])
    learners: Mapping[str, MakeLearner] = field(default_factory=dict[str, MakeLearner])


def _tell_nobody(_: Cloning) -> None:
    pass


def make_learners(
    config: TrainConfig,
    pool: Pool,
    own: OwnParts | None = None,
    *,
    is_new: bool = True,
    on_cloning: OnCloning = _tell_nobody,
) -> dict[str, Learner]:
    """Return a learner for each policy of ``pool``, by name.

    Args:
        config: Settings of every policy.
        pool: The games.
        own: What takes the place of Ludus's networks and algorithms.
        is_new: Whether the policies begin by cloning the demonstrations that ``config.imitate``
            names; a run that is resumed has done so.
        on_cloning: Is told how far that is.

    Raises:
        ConfigError: A setting of the scene is unknown or does not fit, or the demonstrations do
            not.
        SetupError: ``config.imitate`` needs Minari, which is missing.
        RunError: The demonstrations cannot be read.
        UsageError: ``own`` names a policy that the game does not have, or makes something else.
    """
    own = own or OwnParts()
    for name in [*own.networks, *own.learners]:
        if name not in pool.policies:
            raise UsageError(
                f"networks or learners: there is no policy {name!r}",
                f"policies of the game: {', '.join(pool.policies)}",
            )
    demonstrations = _demonstrations(config, pool)
    learners: dict[str, Learner] = {}
    for name in pool.policies:
        shown = demonstrations.get(name)
        learners[name] = _make_learner(
            name, config, pool, own, shown, on_cloning=on_cloning if is_new else None
        )
    return learners


def _demonstrations(config: TrainConfig, pool: Pool) -> dict[str, Demonstrations]:
    if config.imitate is None:
        return {}
    found = read_demonstrations(config.imitate, pool.policies)
    for name in found:
        algorithm = config.policies[name].algorithm
        if algorithm != "ppo":
            raise ConfigError(
                f"policy {name}: {algorithm} does not learn from demonstrations (imitate)",
                f"set policies.{name}.algorithm to ppo, or leave out imitate",
            )
    return found


def policy_seed(seed: int, policy: str) -> int:
    """Return a seed that no other policy of the run has."""
    entropy = (seed, zlib.crc32(policy.encode()))
    return int(np.random.SeedSequence(entropy).generate_state(1, np.uint64)[0] >> np.uint64(1))


def _make_learner(
    name: str,
    config: TrainConfig,
    pool: Pool,
    own: OwnParts,
    demonstrations: Demonstrations | None,
    *,
    on_cloning: OnCloning | None,
) -> Learner:
    settings = config.policies[name]
    network, make_own = own.networks.get(name), own.learners.get(name)
    about = LearnerSettings(
        engine_rows=[pool.rows(name, engine) for engine in range(pool.num_engines)],
        seed=policy_seed(config.seed or 0, name),
    )
    with cast(Any, torch.random).fork_rng(devices=[]):
        device = choose_device(config.device)
        if config.device == "auto" and device.type == "cuda" and make_own is None:
            device = _faster_device(pool.policies[name], config, network, about)
        is_mixed = uses_bfloat16(config, device)
        about = replace(about, is_mixed=is_mixed, is_compiled=config.compile)
        cast(Any, torch).manual_seed(about.seed)
        policy = Policy(pool.policies[name], settings, network).to(device)
        if demonstrations is not None and isinstance(settings, PPOConfig):
            length = settings.sequence_length
            imitation = Imitation(policy, demonstrations, config.imitation, length)
            if on_cloning is not None:
                imitation.clone(policy, about.seed, on_cloning)
            about = replace(about, imitation=imitation)
        if make_own is not None:
            return _checked(make_own(policy, settings, about), name)
        return _learner(policy, settings, about)


def _faster_device(
    spec: PolicySpec, config: TrainConfig, network: MakeNetwork | None, about: LearnerSettings
) -> torch.device:
    settings = for_a_trial(config.policies[spec.name], about.engine_rows[-1].stop)

    def make(device: torch.device) -> Learner:
        policy = Policy(spec, settings, network).to(device)
        return _learner(policy, settings, replace(about, is_mixed=uses_bfloat16(config, device)))

    return faster_device(spec, about.engine_rows, make)


def _learner(policy: Policy, settings: PolicyConfig, about: LearnerSettings) -> Learner:
    if isinstance(settings, PPOConfig):
        return PPO(policy, settings, about)
    from ludus.algorithms.sac import SAC

    return SAC(policy, settings, about)


def _checked(learner: object, policy: str) -> Learner:
    if isinstance(learner, Learner):
        return learner
    names = [name for name in dir(Learner) if not name.startswith("_")]
    missing = [name for name in names if not hasattr(learner, name)]
    raise UsageError(
        f"the learner of policy {policy}, {type(learner).__name__}, lacks {', '.join(missing)}",
        "ludus.algorithms.Learner lists what a learner has",
    )
