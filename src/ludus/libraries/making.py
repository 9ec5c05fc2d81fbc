"""``ludus.make`` and ``ludus.make_vec``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from gymnasium.vector import AutoresetMode

from ludus.arguments import check_arguments
from ludus.engine.bevy_build import with_view
from ludus.engine.screen import with_display
from ludus.errors import (
    ArgumentError,
    EngineError,
    LudusError,
    SetupError,
    UsageError,
    did_you_mean,
)
from ludus.libraries.autoreset import read_mode
from ludus.libraries.others import Player
from ludus.libraries.recipe import Recipe
from ludus.libraries.registration import AGENTS_PER_WORLD
from ludus.libraries.rendering import RENDER_MODES
from ludus.libraries.single import LudusEnv
from ludus.libraries.vector import LudusVectorEnv
from ludus.pool import EnginePool, PoolConfig, open_pool
from ludus.settings.plain import fit_parameters
from ludus.target import EngineTarget, Gymnasium, Legacy, Target, check_accepted, parse_target

__all__ = ["make", "make_registered_vec", "make_vec", "open_game", "refuse_several_worlds"]

_Env = TypeVar("_Env", LudusEnv, LudusVectorEnv)


@check_arguments
def make(
    target: str | Path,
    *,
    policy: str | None = None,
    others: Mapping[str, Player] | None = None,
    render_mode: str | None = None,
    **settings: Any,
) -> LudusEnv:
    """Start a game as a ``gymnasium.Env``.

    Args:
        target: A bundled example (``"cartpole"``), a project folder, a ``.tscn``, an exported game,
            or any other word that docs/targets.md lists.
        policy: Name of the agent's policy, None if there is only one.
        others: What agents of other policies do, by policy: a policy file, or a function from a
            batch of observations to a batch of actions. Those not named act at random.
        render_mode: ``"human"`` opens a window and plays at the speed of the game; ``"rgb_array"``
            lets ``render`` return pictures, where this machine can draw.
        settings: Fields of :class:`ludus.PoolConfig`, such as ``scene="res://level.tscn"``,
            ``ticks_per_step=4`` or ``godot="/path/to/godot"``; of a game of a legacy bridge also
            what its wire does not tell, such as ``action_space=…``.

    Raises:
        ArgumentError: An argument is unknown, or has the wrong type.
        UsageError: The policy has several agents in a world, or settings ask for several worlds.
        TargetError: The target cannot be run.
        EngineNotFound: There is no engine to run it with.
        EngineError: The engine did not start.
    """
    refuse_several_worlds("ludus.make", settings)
    recipe = Recipe.of(
        "make",
        target,
        {"policy": policy, "others": others, "render_mode": render_mode, **settings},
    )
    pool, obstacle = open_game("make", target, settings, render_mode)
    return _made(recipe, pool, LudusEnv, policy, render_mode, others=others, obstacle=obstacle)


@check_arguments
def make_vec(
    target: str | Path,
    *,
    num_worlds: int = 1,
    num_engines: int = 1,
    policy: str | None = None,
    others: Mapping[str, Player] | None = None,
    render_mode: str | None = None,
    autoreset_mode: str | AutoresetMode = "same_step",
    randomise: Mapping[str, Any] | None = None,
    **settings: Any,
) -> LudusVectorEnv:
    """Start a game as a ``gymnasium.vector.VectorEnv``.

    Args:
        target: As for :func:`make`.
        num_worlds: Worlds per engine.
        num_engines: Game processes; there are engines × worlds × agents environments.
        policy: Whose agents, None if there is only one policy.
        others: As for :func:`make`.
        render_mode: As for :func:`make`.
        autoreset_mode: ``"same_step"``, ``"next_step"`` or ``"disabled"``: see
            :class:`ludus.LudusVectorEnv`.
        randomise: Parameters of the worlds by name: a value, or ``{"uniform": [low, high]}``,
            ``{"normal": [mean, deviation]}`` or ``{"choice": [value, …]}``, from which a world
            draws when its agents begin an episode together. ``options["parameters"]`` wins.
        settings: As for :func:`make`.

    Raises:
        ArgumentError: An argument is unknown, or has the wrong type.
        UsageError: Several policies and none chosen, or agents of a world end one by one, which
            ``autoreset_mode`` does not allow.
        ConfigError: A setting is out of range, or a parameter is no value and no sampler.
        TargetError: The target cannot be run.
        EngineNotFound: There is no engine to run it with.
        EngineError: An engine did not start.
    """
    mode = read_mode(autoreset_mode)
    settings = {**settings, "num_worlds": num_worlds, "num_engines": num_engines}
    recipe = Recipe.of(
        "make_vec",
        target,
        {
            "policy": policy,
            "others": others,
            "render_mode": render_mode,
            "autoreset_mode": mode.name.lower(),
            "randomise": randomise,
            **settings,
        },
    )
    parameters = fit_parameters(randomise or {})
    pool, obstacle = open_game("make_vec", target, settings, render_mode)
    if parameters:
        pool.randomise(parameters)
    return _made(
        recipe,
        pool,
        LudusVectorEnv,
        policy,
        render_mode,
        autoreset_mode=mode,
        others=others,
        obstacle=obstacle,
    )


def make_registered_vec(
    target: str, *, num_envs: int = 1, num_engines: int = 1, **settings: Any
) -> LudusVectorEnv:
    """Serve ``gymnasium.make_vec``: ``num_envs`` agents, in one engine unless told otherwise.

    Raises:
        UsageError: The agents of so many worlds are not ``num_envs``; the text says which are.
    """
    per_world = AGENTS_PER_WORLD.get(target, 1)
    while True:
        unit = per_world * num_engines
        if num_envs < 1 or num_envs % unit:
            near = max(unit, num_envs // unit * unit)
            raise UsageError(
                f"num_envs is {num_envs}, which is no multiple of {num_engines} (engines) × "
                f"{per_world} (agents in a world)",
                hint=f"{near} or {near + unit} would do",
            )
        envs = make_vec(target, num_worlds=num_envs // unit, num_engines=num_engines, **settings)
        if envs.num_envs == num_envs:
            return envs
        # Only the game tells how many agents a world has.
        per_world = envs.policy.agents_per_world
        envs.close()


def refuse_several_worlds(function: str, settings: Mapping[str, Any]) -> None:
    """Refuse settings that ask for several worlds of a function that starts one."""
    for name in ("num_worlds", "num_engines"):
        if settings.get(name, 1) != 1:
            raise UsageError(
                f"{function} starts one world, but {name} is {settings[name]!r}",
                hint="ludus.make_vec and ludus.open_pool have as many as you like",
            )


def open_game(
    function: str, target: str | Path, settings: Mapping[str, Any], render_mode: str | None
) -> tuple[EnginePool, LudusError | None]:
    """Start a game for one of the functions of this package.

    Args:
        function: Whose refusals of targets hold.
        target: What to open.
        settings: Fields of :class:`ludus.PoolConfig`.
        render_mode: ``"human"``, ``"rgb_array"`` or None.

    Returns:
        The game, and with ``"rgb_array"`` why it cannot draw, or None if it can.

    Raises:
        ArgumentError: Unknown settings.
        UsageError: There is no such render mode.
        TargetError: The target cannot be run.
        EngineNotFound: There is no engine to run it with.
        EngineError: An engine did not start.
    """
    if render_mode not in (None, *RENDER_MODES):
        raise UsageError(f"render_mode is {render_mode!r}, expected 'human', 'rgb_array' or None")
    settings = dict(settings)
    if isinstance(settings.get("godot"), str):
        settings["godot"] = Path(settings["godot"])
    name = with_view(str(target)) if render_mode == "rgb_array" else target
    parsed = parse_target(name, scene=settings.get("scene"), godot=settings.get("godot"))
    check_accepted(function, parsed)
    if isinstance(parsed, Legacy):
        settings = _split_for_bridge(settings)
    known = PoolConfig.__dataclass_fields__
    for unknown in sorted(settings.keys() - known):  # TorchRL looks for just these words
        meant = "num_worlds" if unknown == "num_envs" else unknown  # as Gymnasium has it
        hint = did_you_mean(meant, known, "settings are")
        raise ArgumentError(f"unexpected keyword argument {unknown!r}", hint)
    config = PoolConfig(**settings)
    if render_mode == "human":
        launch = replace(config.launch, is_windowed=True, is_real_time=True)
        config = replace(config, launch=launch)
    if render_mode == "rgb_array":
        return _open_drawing(parsed, config)
    return open_pool(parsed, config), None


def _open_drawing(target: Target, config: PoolConfig) -> tuple[EnginePool, LudusError | None]:
    """Open a game that draws when asked; where it cannot, one that does not, and say why."""
    if isinstance(target, Gymnasium):
        return open_pool(target, config, render_mode="rgb_array"), None
    if not isinstance(target, EngineTarget):
        return open_pool(target, config), SetupError(
            f"games of this legacy bridge draw for themselves, not for Python ({target.name})"
        )
    try:
        with_display(("true",))
        launch = replace(config.launch, gives_pictures=True)
        return open_pool(target, replace(config, launch=launch)), None
    except (SetupError, EngineError) as error:
        return open_pool(target, config), error


def _split_for_bridge(settings: dict[str, Any]) -> dict[str, Any]:
    """Move settings that the pool does not have into ``bridge``, which checks them."""
    of_pool = PoolConfig.__dataclass_fields__
    own = {name: value for name, value in settings.items() if name not in of_pool}
    rest = {name: value for name, value in settings.items() if name in of_pool}
    return {**rest, "bridge": {**rest.get("bridge", {}), **own}}


def _made(recipe: Recipe, pool: EnginePool, kind: type[_Env], *args: Any, **kwargs: Any) -> _Env:
    try:
        env = kind(pool, *args, **kwargs)
    except BaseException:
        pool.close()
        raise
    env.recipe = replace(recipe, num_envs=getattr(env, "num_envs", 1))
    env.spec = env.recipe.spec
    return env
