"""Open the pool that a config asks for: real engines, or any Gymnasium environment."""

from __future__ import annotations

from pathlib import Path

from ludus.errors import ConfigError
from ludus.pool.interface import Pool
from ludus.settings.train_config import TrainConfig

__all__ = ["GYMNASIUM_PREFIX", "open_source"]

GYMNASIUM_PREFIX = "gym:"


def open_source(config: TrainConfig, log_dir: Path | None = None) -> Pool:
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
    if config.target.startswith(GYMNASIUM_PREFIX):
        from ludus.pool.gymnasium_pool import GymnasiumPool

        return GymnasiumPool(
            config.target.removeprefix(GYMNASIUM_PREFIX),
            num_worlds=config.num_worlds,
            num_engines=config.num_engines,
            max_episode_steps=config.max_episode_steps,
        )
    from ludus.pool import PoolConfig, open_pool

    return open_pool(
        config.target,
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
