"""What to film, with whom, how long: everything behind ``ludus record``."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

from ludus.engine import Target, TargetKind, resolve_target
from ludus.engine.bevy_build import with_view
from ludus.errors import ConfigError, TargetError
from ludus.pool import PoolConfig, open_pool
from ludus.pool.interface import Pool
from ludus.record.film import Film, check_out
from ludus.record.film_kinds import choose_rate
from ludus.record.players import Act, file_player, find_run, random_player, run_player

__all__ = ["RecordConfig", "Recorded", "record"]

DEFAULT_SECONDS = 10.0
MAX_SECONDS = 600.0
"""Of a film that ends with an episode."""


@dataclass(frozen=True, kw_only=True)
class RecordConfig:
    """What to film.

    Attributes:
        target: As for :func:`ludus.make`, ``gym:ENV_ID``, or a run folder, which is then the
            policy, too.
        out: File to write; its ending says which kind of film.
        policy: A run folder or one of its checkpoints, or policy files, one for each policy of
            the game. Empty: the game as it is.
        is_random: Take random actions.
        is_stochastic: Draw actions as in training, instead of taking the most probable ones.
        num_episodes: End after so many episodes of every policy; None: with ``seconds``.
        seconds: Length of the film, at most. None: ten, or ten minutes with ``num_episodes``.
        start: Seconds left out at the beginning.
        frames_per_second: Of the film, the game's own or a whole fraction of it; None: at most
            30, of a GIF 20.
        width: Of the film, pixels; None: the window's.
        window: Width and height of the game's window, pixels; None: the project's.
        scene: Scene of the project; None: the one that was trained, or the main scene.
        seed: Of worlds and of samples.
        godot: Engine to use; None: the one that is found.
    """

    target: str
    out: Path
    policy: tuple[Path, ...] = ()
    is_random: bool = False
    is_stochastic: bool = False
    num_episodes: int | None = None
    seconds: float | None = None
    start: float = 0.0
    frames_per_second: float | None = None
    width: int | None = None
    window: tuple[int, int] | None = None
    scene: str | Path | None = None
    seed: int = 0
    godot: Path | None = None
    ticks_per_step: int | None = None
    max_episode_steps: int | None = None

    @property
    def longest(self) -> float:
        """Seconds after which the film ends in any case."""
        usual = DEFAULT_SECONDS if self.num_episodes is None else MAX_SECONDS
        return usual if self.seconds is None else self.seconds


@dataclass(frozen=True)
class Recorded:
    """A film that was written.

    Attributes:
        path: The file.
        num_frames: Its frames.
        frames_per_second: Its pace.
        num_episodes: Episodes that ended in it, by policy.
    """

    path: Path
    num_frames: int
    frames_per_second: Fraction
    num_episodes: dict[str, int]

    @property
    def seconds(self) -> float:
        """How long it plays."""
        return float(self.num_frames / self.frames_per_second)


def record(config: RecordConfig) -> Recorded:
    """Play a game and write a film of it.

    Raises:
        ConfigError: Settings contradict each other, or cannot be had.
        TargetError: The target cannot be run, has no window, or gives no pictures.
        SetupError: A package, a screen or a renderer is missing.
        EngineError: The game failed.
        RunError: The film could not be written.
    """
    config = _with_run(config)
    _check(config)
    check_out(config.out)
    if config.target.startswith("gym:"):
        return _record_gymnasium(config)
    target = resolve_target(with_view(config.target), scene=config.scene, godot=config.godot)
    if target.kind is TargetKind.EXECUTABLE:
        return _record_pictures(config, target)
    return _record_game(config, target)


def _with_run(config: RecordConfig) -> RecordConfig:
    """Take from a run what it was trained with."""
    target = find_run(Path(config.target))
    if target is not None:
        config = replace(config, policy=config.policy or (target,))
    run = find_run(config.policy[0]) if len(config.policy) == 1 else None
    if run is None:
        return config
    from ludus.runs.run_folder import RunFolder

    trained = RunFolder.find(run).read_config()
    return replace(
        config,
        target=config.target if target is None else trained.target,
        scene=config.scene or (trained.scene if target is not None else None),
        godot=config.godot or trained.godot,
        ticks_per_step=trained.ticks_per_step,
        max_episode_steps=trained.max_episode_steps,
    )


def _check(config: RecordConfig) -> None:
    if config.policy and config.is_random:
        raise ConfigError("--policy and --random exclude each other")
    if config.num_episodes is not None and config.num_episodes < 1:
        raise ConfigError(f"episodes must be at least 1, not {config.num_episodes}")
    if config.longest <= 0.0 or config.start < 0.0:
        raise ConfigError(
            f"a film of {config.longest:g} s from second {config.start:g} cannot be taken"
        )
    if config.num_episodes is not None and not (config.policy or config.is_random):
        raise ConfigError(
            "the length is a number of episodes, but nobody plays that could count them",
            hint="use --seconds, or --policy or --random",
        )
    for path in config.policy:
        if not path.exists():
            raise ConfigError(f"there is no run or policy file {path}", hint="ludus runs")


def _player(config: RecordConfig) -> Callable[[Pool], Act]:
    if not config.policy:
        return lambda pool: random_player(pool, config.seed)
    run = find_run(config.policy[0]) if len(config.policy) == 1 else None
    samples = config.is_stochastic
    if run is not None:
        return lambda pool: run_player(pool, run, config.seed, is_stochastic=samples)
    return lambda pool: file_player(pool, config.policy, config.seed, is_stochastic=samples)


def _pool_config(config: RecordConfig) -> PoolConfig:
    return PoolConfig(
        ticks_per_step=config.ticks_per_step,
        max_episode_steps=config.max_episode_steps,
        godot=config.godot,
    )


def _record_game(config: RecordConfig, target: Target) -> Recorded:
    from ludus.record import game_film

    rate = game_film.game_rate(game_film.require_project(target))
    film_rate = choose_rate(check_out(config.out), rate, config.frames_per_second)
    ended: dict[str, int] = {}
    with Film(config.out, film_rate, config.width) as film:
        shot = game_film.Shot(
            film=film,
            every=int(rate / film_rate),
            num_frames=_frames(config.longest, film_rate),
            num_episodes=config.num_episodes,
            num_skipped=round(config.start * film_rate),
            window=config.window,
            seed=config.seed,
        )
        if config.policy or config.is_random:
            ended = game_film.film_played(target, _pool_config(config), _player(config), shot)
        else:
            game_film.film_alone(target, shot)
    return Recorded(config.out, film.num_frames, film_rate, ended)


def _record_pictures(config: RecordConfig, target: Target) -> Recorded:
    from ludus.record import picture_film

    if not (config.policy or config.is_random):
        raise TargetError(
            f"{target.name} is an exported game, which is filmed only while somebody plays it",
            hint="use --policy or --random with a game made with Bevy; of one made with Godot, "
            "film the project that it was exported from",
        )
    assert target.executable is not None, "it is an executable"
    with open_pool(target.executable, _pool_config(config)) as pool:
        rate = picture_film.picture_rate(pool)
        film_rate = choose_rate(check_out(config.out), rate, config.frames_per_second)
        with Film(config.out, film_rate, config.width) as film:
            ended = picture_film.film_pictures(
                pool,
                _player(config),
                film,
                every=int(rate / film_rate),
                num_frames=_frames(config.longest, film_rate),
                num_skipped=round(config.start * film_rate),
                num_episodes=config.num_episodes,
                seed=config.seed,
            )
    return Recorded(config.out, film.num_frames, film_rate, ended)


def _record_gymnasium(config: RecordConfig) -> Recorded:
    from ludus.record import gym_film
    from ludus.record.screen import screen

    env_id = config.target.removeprefix(gym_film.GYMNASIUM_PREFIX)
    with screen(), contextlib.ExitStack() as stack:
        env = gym_film.make_rendering(env_id, config.max_episode_steps)
        stack.callback(env.close)
        rate = gym_film.env_rate(env)
        film_rate = choose_rate(check_out(config.out), rate, config.frames_per_second)
        with Film(config.out, film_rate, config.width) as film:
            ended = gym_film.film_gymnasium(
                env,
                _player(config),
                film,
                every=int(rate / film_rate),
                num_frames=_frames(config.longest, film_rate),
                num_skipped=round(config.start * film_rate),
                num_episodes=config.num_episodes,
                seed=config.seed,
            )
    return Recorded(config.out, film.num_frames, film_rate, ended)


def _frames(seconds: float, rate: Fraction) -> int:
    return max(1, round(seconds * rate))
