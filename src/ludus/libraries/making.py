"""``ludus.make`` and ``ludus.make_vec``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from ludus.errors import UsageError
from ludus.libraries.single import LudusEnv
from ludus.libraries.vector import LudusVectorEnv
from ludus.pool import EnginePool, PoolConfig, open_pool
from ludus.session import LaunchOptions
from ludus.target import Legacy, check_accepted, parse_target

__all__ = ["make", "make_registered_vec", "make_vec"]

_Env = TypeVar("_Env", LudusEnv, LudusVectorEnv)
_RENDER_MODES = (None, "human")


def make(
    target: str | Path,
    *,
    policy: str | None = None,
    render_mode: str | None = None,
    **settings: Any,
) -> LudusEnv:
    """Start a game as a ``gymnasium.Env``.

    Args:
        target: A bundled example (``"cartpole"``), a project folder, a ``.tscn``, an exported game,
            or any other word that docs/targets.md lists.
        policy: Name of the agent's policy, None if there is only one.
        render_mode: ``"human"`` opens a window and plays at the speed of the game.
        settings: Fields of :class:`ludus.PoolConfig`, such as ``scene="res://level.tscn"``,
            ``ticks_per_step=4`` or ``godot="/path/to/godot"``; of a game of a legacy bridge also
            what its wire does not tell, such as ``action_space=…``.

    Raises:
        UsageError: Unknown settings, or a world with more than one agent.
        TargetError: The target cannot be run.
        EngineNotFound: There is no engine to run it with.
        EngineError: The engine did not start.
    """
    settings = {**settings, "num_worlds": 1, "num_engines": 1}
    pool = _open("make", target, settings, render_mode)
    return _wrapped(LudusEnv, pool, policy, render_mode)


def make_vec(
    target: str | Path,
    *,
    num_worlds: int = 1,
    num_engines: int = 1,
    policy: str | None = None,
    render_mode: str | None = None,
    **settings: Any,
) -> LudusVectorEnv:
    """Start a game as a ``gymnasium.vector.VectorEnv``.

    Args:
        target: As for :func:`make`.
        num_worlds: Worlds per engine.
        num_engines: Game processes; there are engines × worlds × agents environments.
        policy: Whose agents, None if there is only one policy.
        render_mode: ``"human"`` opens a window and plays at the speed of the game.
        settings: As for :func:`make`.

    Raises:
        UsageError: Unknown settings, or several policies and none chosen.
        TargetError: The target cannot be run.
        EngineNotFound: There is no engine to run it with.
        EngineError: An engine did not start.
    """
    settings = {**settings, "num_worlds": num_worlds, "num_engines": num_engines}
    pool = _open("make_vec", target, settings, render_mode)
    return _wrapped(LudusVectorEnv, pool, policy, render_mode)


def make_registered_vec(target: str, *, num_envs: int = 1, **settings: Any) -> LudusVectorEnv:
    """Serve ``gymnasium.make_vec``: ``num_envs`` worlds, in one engine unless told otherwise."""
    num_engines = int(settings.get("num_engines", 1))
    if num_envs % num_engines:
        raise UsageError(f"num_envs is {num_envs}, which {num_engines} engines cannot share evenly")
    return make_vec(target, num_worlds=num_envs // num_engines, **settings)


def _open(
    function: str, target: str | Path, settings: dict[str, Any], render_mode: str | None
) -> EnginePool:
    if render_mode not in _RENDER_MODES:
        raise UsageError(f"render_mode is {render_mode!r}, expected 'human' or None")
    if isinstance(settings.get("godot"), str):
        settings["godot"] = Path(settings["godot"])
    parsed = parse_target(target, scene=settings.get("scene"), godot=settings.get("godot"))
    check_accepted(function, parsed)
    if isinstance(parsed, Legacy):
        settings = _split_for_bridge(settings)
    try:
        config = PoolConfig(**settings)
    except TypeError as error:
        known = ", ".join(PoolConfig.__dataclass_fields__)
        raise UsageError(f"unknown setting: {error}", hint=f"settings are {known}") from error
    if render_mode == "human":
        launch: LaunchOptions = replace(config.launch, is_windowed=True, is_real_time=True)
        config = replace(config, launch=launch)
    return open_pool(parsed, config)


def _split_for_bridge(settings: dict[str, Any]) -> dict[str, Any]:
    """Move settings that the pool does not have into ``bridge``, which checks them."""
    of_pool = PoolConfig.__dataclass_fields__
    own = {name: value for name, value in settings.items() if name not in of_pool}
    rest = {name: value for name, value in settings.items() if name in of_pool}
    return {**rest, "bridge": {**rest.get("bridge", {}), **own}}


def _wrapped(
    kind: type[_Env], pool: EnginePool, policy: str | None, render_mode: str | None
) -> _Env:
    try:
        return kind(pool, policy, render_mode)
    except BaseException:
        pool.close()
        raise
