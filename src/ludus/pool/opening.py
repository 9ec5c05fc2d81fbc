"""Open a pool of engines on a target."""

from __future__ import annotations

import os
from dataclasses import dataclass, field, replace
from pathlib import Path

from ludus.engine import Target, allowed_cores, plan_cores, resolve_target
from ludus.errors import ConfigError
from ludus.pool.engine_pool import EnginePool
from ludus.session import EngineSession, LaunchOptions, open_session
from ludus.wire.handshake import EngineConfig

__all__ = ["PoolConfig", "open_pool", "spin_us_beside"]

DEFAULT_SPIN_US = 3000


@dataclass(frozen=True, kw_only=True)
class PoolConfig:
    """Engines and worlds of a pool.

    Attributes:
        scene: Scene of the project to make worlds of; None: its main scene.
        num_worlds: Worlds per engine.
        num_engines: Game processes.
        layout: ``"scene"`` (what the scene asks for), ``"isolated"`` or ``"grid"``.
        ticks_per_step: Physics ticks per decision; None: what the agents say.
        max_episode_steps: Steps until truncation; None: what the agents say.
        godot: Engine to use; None: the one that is found.
        log_dir: Folder for the engines' output.
        max_restarts: How often, in all, an engine that died or froze is started again.
        is_pinned: Give each engine a core of its own.
        spin_us: How long both sides look for a message again and again before they sleep; None:
            3000 where a core is left beside the engines, else 0.
        launch: How games are started and watched.
    """

    scene: str | Path | None = None
    num_worlds: int = 1
    num_engines: int = 1
    layout: str = "scene"
    ticks_per_step: int | None = None
    max_episode_steps: int | None = None
    godot: Path | None = None
    log_dir: Path | None = None
    max_restarts: int = 0
    is_pinned: bool = True
    spin_us: int | None = None
    launch: LaunchOptions = field(default_factory=LaunchOptions)


def open_pool(target: str | Path, config: PoolConfig | None = None) -> EnginePool:
    """Start the engines of ``target`` and return them as one environment.

    Args:
        target: A bundled example, a project folder, a ``.tscn``, an exported game,
            ``host:port``, or ``"play"`` (wait until somebody presses Play).
        config: Engines and worlds.

    Raises:
        ConfigError: A number is out of range.
        TargetError: The target cannot be run.
        EngineNotFound: There is no engine to run it with.
        EngineError: An engine did not start.
    """
    config = config or PoolConfig()
    resolved = resolve_target(target, scene=config.scene, godot=config.godot)
    _check(config, resolved)
    cores = plan_cores(config.num_engines).engines if config.is_pinned else ()

    def open_engine(engine: int) -> EngineSession:
        name = f"engine-{engine}.log"
        options = replace(
            config.launch,
            cores=cores[engine] if cores else None,
            log_path=config.log_dir / name if config.log_dir else None,
        )
        return open_session(resolved, _engine_config(config, engine), options)

    return EnginePool(open_engine, config.num_engines, config.max_restarts)


def _check(config: PoolConfig, target: Target) -> None:
    if config.num_worlds < 1 or config.num_engines < 1:
        raise ConfigError(
            f"num_worlds is {config.num_worlds}, num_engines {config.num_engines}: "
            "both must be at least 1"
        )
    if config.layout not in {"scene", "isolated", "grid"}:
        raise ConfigError(f"layout is {config.layout!r}, expected scene, isolated or grid")
    if config.num_engines > 1 and not target.is_started_by_us:
        raise ConfigError("a game that is started by hand is one engine: num_engines must be 1")


def _engine_config(config: PoolConfig, engine: int) -> EngineConfig:
    return EngineConfig(
        num_worlds=config.num_worlds,
        first_world=engine * config.num_worlds,
        layout=config.layout,
        ticks_per_step=config.ticks_per_step,
        max_episode_steps=config.max_episode_steps,
        spin_us=_spin_us(config),
    )


def spin_us_beside(num_engines: int) -> int:
    """Return how long to look for a message before going to sleep, microseconds.

    Spinning pays where it takes no core from an engine: a sleeper wakes slowly, caches cold.
    """
    num_cores = len(allowed_cores() or ()) or os.cpu_count() or 1
    return DEFAULT_SPIN_US if num_engines < num_cores else 0


def _spin_us(config: PoolConfig) -> int:
    if config.spin_us is not None:
        return config.spin_us
    return 0 if config.launch.is_real_time else spin_us_beside(config.num_engines)
