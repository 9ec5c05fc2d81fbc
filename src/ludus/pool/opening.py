"""Open a pool of engines on a target."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ludus.arguments import check_arguments
from ludus.engine import (
    CorePlan,
    ReservedCores,
    num_cores,
    reserve_cores,
)
from ludus.errors import ConfigError
from ludus.legacy.registry import (
    GameAddress,
    bridge_of,
    open_bridge_session,
    read_settings,
)
from ludus.pool.engine_pool import EnginePool
from ludus.session import Session, open_session
from ludus.session.gymnasium_session import GymEnv, GymnasiumSession, make_environment
from ludus.settings.pool_config import PoolConfig
from ludus.target import (
    Address,
    EngineTarget,
    Gymnasium,
    Legacy,
    Play,
    PolicyFile,
    Run,
    Target,
    check_accepted,
    parse_target,
    prepare,
)
from ludus.wire.handshake import EngineConfig

__all__ = ["check_settings", "open_pool", "spin_us_beside"]

DEFAULT_SPIN_US = 3000
_NOT_OF_ENVIRONMENTS = ("scene", "layout", "ticks_per_step", "godot", "spin_us", "token_file")
"""Settings that mean nothing to an environment of Gymnasium."""
_NOT_OF_BRIDGES = (*_NOT_OF_ENVIRONMENTS, "num_worlds", "launch")
"""Settings that mean nothing to a game of a legacy bridge, but for the window of some."""


@check_arguments
def open_pool(
    target: str | Path | Target,
    config: PoolConfig | None = None,
    *,
    render_mode: str | None = None,
) -> EnginePool:
    """Start the engines of ``target`` and return them as one environment.

    Args:
        target: What docs/targets.md lists, as text or already parsed. With a parsed target,
            ``scene`` and ``godot`` of ``config`` are not read.
        config: Engines and worlds.
        render_mode: Of environments of Gymnasium; None: ``"human"`` where ``config`` asks for a
            window.

    Raises:
        ArgumentError: An argument has the wrong type.
        ConfigError: A setting is out of range, or means nothing to this target.
        TargetError: The target cannot be run.
        EngineNotFound: There is no engine to run it with.
        EngineError: An engine did not start.
    """
    config = config or PoolConfig()
    if isinstance(target, str | Path):
        target = parse_target(target, scene=config.scene, godot=config.godot)
    check_accepted("open_pool", target)
    match target:
        case Gymnasium():
            return _open_environments(target, config, render_mode)
        case Legacy():
            return _open_legacy_games(target, config)
        case Run() | PolicyFile():
            raise AssertionError("check_accepted refuses them")
        case _:
            return _open_engines(target, config)


def _open_engines(target: EngineTarget, config: PoolConfig) -> EnginePool:
    _check(config, target)
    launch = config.launch
    if config.token_file is not None:
        launch = replace(launch, token=_read_token(config.token_file))
    game = prepare(target)
    cores = _reserve_cores(config, is_started_by_us=not isinstance(game, Address | Play))

    def open_engine(engine: int) -> Session:
        pinned = cores.plan.engines[engine]
        options = replace(launch, cores=pinned, log_path=_log_path(config, engine))
        return open_session(game, _engine_config(config, engine), options)

    return EnginePool(open_engine, config.num_engines, config.max_restarts, cores)


def _read_token(path: Path) -> str:
    try:
        return path.expanduser().read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(
            f"token_file {path} cannot be read: {error}",
            hint="it must be a text file with the token that the game was started with",
        ) from error


def _open_environments(
    target: Gymnasium, config: PoolConfig, render_mode: str | None
) -> EnginePool:
    check_settings(target, config)
    render_mode = render_mode or ("human" if config.launch.is_windowed else None)
    with contextlib.ExitStack() as stack:

        def make() -> GymEnv:
            env = make_environment(target.env_id, config.max_episode_steps, render_mode)
            stack.callback(env.close)
            return env

        # All are made here, as an environment may hold what belongs to the thread that made it;
        # and only once, as one that fails would fail again.
        sessions = [
            GymnasiumSession([make() for _ in range(config.num_worlds)], target.env_id)
            for _ in range(config.num_engines)
        ]
        stack.pop_all()  # the pool closes them from now on
    return EnginePool(sessions.__getitem__, config.num_engines)


def _open_legacy_games(target: Legacy, config: PoolConfig) -> EnginePool:
    bridge = bridge_of(target)
    settings = read_settings(bridge, config.bridge)
    check_settings(target, config)
    if config.launch.is_windowed:
        settings["show_window"] = True
    cores = _reserve_cores(config)

    def open_engine(engine: int) -> Session:
        place = GameAddress(
            address=bridge.place_of(target.name),
            num_games=config.num_engines,
            number=engine,
            cores=cores.plan.engines[engine],
            log_path=_log_path(config, engine),
            engine_args=config.launch.engine_args,
        )
        return open_bridge_session(bridge, place, settings, config.max_episode_steps)

    return EnginePool(open_engine, config.num_engines, config.max_restarts, cores)


def _reserve_cores(config: PoolConfig, *, is_started_by_us: bool = True) -> ReservedCores:
    # What a game that draws does beside its physics (events of its window among them) takes the
    # time of other cores: pinned to one, it steps at 0.7 times the speed.
    if config.is_pinned and is_started_by_us and not config.launch.gives_pictures:
        return reserve_cores(config.num_engines)
    return ReservedCores(CorePlan((None,) * config.num_engines, None))


def _log_path(config: PoolConfig, engine: int) -> Path | None:
    name = f"engine-{config.first_engine + engine}.log"
    return config.log_dir / name if config.log_dir else None


def check_settings(target: Gymnasium | Legacy, config: PoolConfig) -> None:
    """Refuse settings that mean nothing to a Gymnasium environment or a game of a legacy bridge.

    Raises:
        ConfigError: It names them.
    """
    if config.layout == "isolated":  # as it is anyway
        config = replace(config, layout="scene")
    if isinstance(target, Gymnasium):
        _refuse_changed(
            config, _NOT_OF_ENVIRONMENTS, f"{target.name} has no engine", "leave it out"
        )
        return
    bridge = bridge_of(target)
    if bridge.has_window:
        launch = replace(config.launch, is_windowed=False, engine_args=())
        config = replace(config, launch=launch)
    _refuse_changed(
        config,
        _NOT_OF_BRIDGES,
        f"{bridge.form} is one world, as its makers wrote it",
        "leave it out; num_engines is how many games run, if each can listen at a port of its own "
        f"({bridge.page})",
    )


def _refuse_changed(config: PoolConfig, names: Sequence[str], reason: str, hint: str) -> None:
    usual = PoolConfig()
    changed = [name for name in names if getattr(config, name) != getattr(usual, name)]
    if changed:
        raise ConfigError(f"{reason}: {', '.join(changed)} cannot be set", hint)


def _check(config: PoolConfig, target: EngineTarget) -> None:
    if config.bridge:
        raise ConfigError(
            f"{', '.join(config.bridge)} is a setting of legacy bridges, which {target.name} is not"
        )
    if config.num_engines > 1 and isinstance(target, Address | Play):
        raise ConfigError(
            f"a game that is started by hand is one engine, not {config.num_engines}",
            hint="--num-engines 1, or num_engines=1",
        )


def _engine_config(config: PoolConfig, engine: int) -> EngineConfig:
    return EngineConfig(
        num_worlds=config.num_worlds,
        first_world=(config.first_engine + engine) * config.num_worlds,
        layout=config.layout,
        ticks_per_step=config.ticks_per_step,
        max_episode_steps=config.max_episode_steps,
        spin_us=_spin_us(config),
    )


def spin_us_beside(num_engines: int) -> int:
    """Return how long to look for a message before going to sleep, microseconds.

    Spinning pays where it takes no core from an engine: a sleeper wakes slowly, caches cold.
    """
    return DEFAULT_SPIN_US if num_engines < num_cores() else 0


def _spin_us(config: PoolConfig) -> int:
    if config.spin_us is not None:
        return config.spin_us
    return 0 if config.launch.is_real_time else spin_us_beside(config.num_engines)
