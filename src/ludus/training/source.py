"""Open the pool that the settings of a run ask for."""

from __future__ import annotations

from pathlib import Path

from ludus.errors import ConfigError
from ludus.pool import EnginePool, PoolConfig, open_pool
from ludus.settings.train_config import TrainConfig
from ludus.target import check_accepted, parse_target

__all__ = ["open_source"]


def open_source(config: TrainConfig, log_dir: Path | None = None) -> EnginePool:
    """Return the pool of ``config.target``; close it when done.

    Args:
        config: Target, worlds, engines and what goes with them.
        log_dir: Where engines leave their output; None keeps it with the system's logs.

    Raises:
        TargetError: There is no such target.
        ConfigError: No target was given.
        EngineError: The engine did not start.
    """
    if not config.target:
        raise ConfigError("no target was given", "name one: ludus train cartpole")
    target = parse_target(config.target, scene=config.scene, godot=config.godot)
    check_accepted("train", target)
    return open_pool(
        target,
        PoolConfig(
            scene=config.scene,
            num_worlds=config.num_worlds,
            num_engines=config.num_engines,
            layout=config.layout,
            ticks_per_step=config.ticks_per_step,
            max_episode_steps=config.max_episode_steps,
            godot=config.godot,
            log_dir=log_dir,
            max_restarts=config.max_restarts,
        ),
    )
