"""What to film, with whom, how long: everything behind ``ludus record``."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

from ludus.engine import EngineKind
from ludus.engine.bevy_build import with_view
from ludus.errors import ConfigError, TargetError
from ludus.legacy.registry import find_window
from ludus.play.players import MakePlayer, load_player, random_player
from ludus.pool import EnginePool, PoolConfig, open_pool
from ludus.pool.opening import check_settings
from ludus.record.film import Film, check_out
from ludus.record.film_kinds import choose_rate
from ludus.record.shot import Shot
from ludus.session import LaunchOptions
from ludus.settings.checks import ABOVE_0, AT_LEAST_0, AT_LEAST_1, ONLY_1, optional, setting
from ludus.settings.pool_config import GameConfig
from ludus.target import (
    Executable,
    Gymnasium,
    Legacy,
    Scene,
    check_accepted,
    find_run,
    parse_target,
    prepare,
)

__all__ = ["RecordConfig", "Recorded", "check_players", "make_player", "record", "with_run"]

DEFAULT_SECONDS = 10.0
MAX_SECONDS = 600.0
"""Of a film that ends with an episode."""


@dataclass(frozen=True, kw_only=True)
class RecordConfig(GameConfig):
    """What to film.

    Attributes:
        target: A bundled example, a project folder, a scene, gym:ENV_ID, a game of an older
            system, or a run folder, whose agents then play.
        out: File to write: .mp4, .webm or .gif.
        dataset: Instead of a film, write a Minari dataset of this name, such as
            cartpole/expert-v0: complete episodes, 10 by default. Without a policy or random
            actions, a person plays.
        policy: Run folder or checkpoint of trained agents; or policy files (.ludus.json), one for
            each policy of the game; if not given, the game plays as it does for a player.
        is_random: Take random actions.
        is_stochastic: Sample actions as in training, instead of taking the most probable ones.
        num_episodes: End after this many episodes of each policy; if not given, after seconds.
        seconds: Longest film; if not given, 10, or 600 with a number of episodes.
        start: Seconds to skip at the beginning.
        frames_per_second: Frames per second of the film; if not given, half of the game's 60, or a
            third for a .gif.
        width: Width of the film in pixels; if not given, that of the window.
        window: Width and height of the game's window; if not given, those of the project.
        has_overlay: Draw over a Godot 4 game what an agent sees, what it decides and how probable
            that was, and curves of its reward and return.
        scene: Scene of the project; if not given, the one that was trained, or the main scene.
        seed: Seed of worlds and samples.
    """

    target: str
    out: Path | None = None
    dataset: str | None = None
    policy: tuple[Path, ...] = ()
    is_random: bool = False
    is_stochastic: bool = False
    num_engines: int = setting(1, ONLY_1)
    num_episodes: int | None = setting(None, optional(AT_LEAST_1))
    seconds: float | None = setting(None, optional(ABOVE_0))
    start: float = setting(0.0, AT_LEAST_0)
    frames_per_second: float | None = setting(None, optional(ABOVE_0))
    width: int | None = setting(None, optional(AT_LEAST_1))
    window: tuple[int, int] | None = None
    has_overlay: bool = False
    seed: int = 0

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
    config = with_run(config)
    check_players(config)
    if config.num_episodes is not None and not (config.policy or config.is_random):
        raise ConfigError(
            "a number of episodes was given, but nobody plays, so no episode ends",
            hint="use --seconds, or --policy or --random",
        )
    _out(config)
    target = parse_target(with_view(config.target), scene=config.scene, godot=config.godot)
    check_accepted("record", target)
    game = prepare(target)
    is_godot4 = isinstance(game, Scene) and game.project.engine_kind is EngineKind.GODOT4
    if config.has_overlay and not is_godot4:
        raise TargetError(
            f"--overlay shows what agents of a Godot 4 project see, which {target.name} is not",
            hint="leave --overlay out",
        )
    if isinstance(game, Gymnasium | Legacy):
        check_settings(game, PoolConfig.of(config))
    match game:
        case Legacy() if (window := find_window(game)) is not None:
            return _record_game(config, game, *window)
        case Gymnasium() | Legacy() as environment:
            return _record_environment(config, environment)
        case Executable() as game:
            return _record_pictures(config, game)
        case Scene() as scene:
            return _record_game(config, scene, scene, scene.project.ticks_per_second)
        case _:
            raise AssertionError("check_accepted refuses it")


def _out(config: RecordConfig) -> Path:
    """Return the file of a film, whose format is known."""
    if config.out is None:
        raise ConfigError(
            "nothing was named to write", hint="--out film.mp4, or --dataset NAME-v0 for Minari"
        )
    check_out(config.out)
    return config.out


def with_run(config: RecordConfig) -> RecordConfig:
    """Take from a run what it was trained with."""
    target = Path(config.target)
    if is_run := find_run(target) is not None:
        run = target
        if not config.policy and not config.is_random:
            config = replace(config, policy=(target,))
    elif len(config.policy) == 1 and find_run(config.policy[0]) is not None:
        run = config.policy[0]
    else:
        return config
    from ludus.runs.saved import trained_config
    from ludus.runs.trust import PROGRAM_SETTINGS

    names = ("godot", "ticks_per_step", "max_episode_steps", *(["scene"] if is_run else []))
    uses = PROGRAM_SETTINGS if is_run else ("godot",)
    trained = trained_config(run, uses, **{name: getattr(config, name) for name in names})
    changes = {name: getattr(trained, name) for name in names}
    if is_run:
        changes["bridge"] = {**trained.bridge, **config.bridge}
    return replace(config, target=trained.target if is_run else config.target, **changes)


def check_players(config: RecordConfig) -> None:
    """Refuse policies that are missing, or beside random play.

    Raises:
        ConfigError: It says which.
    """
    if config.policy and config.is_random:
        raise ConfigError("--policy and --random exclude each other")
    for path in config.policy:
        if not path.exists():
            raise ConfigError(f"there is no run or policy file {path}", hint="ludus runs")


def make_player(config: RecordConfig) -> MakePlayer:
    """Return how the policies of the settings, or chance, act."""
    if not config.policy:
        return lambda pool: random_player(pool, config.seed)
    return lambda pool: load_player(config.policy, pool, config.seed, config.is_stochastic)


def _record_game(
    config: RecordConfig, game: Scene | Legacy, scene: Scene, frames_per_second: int
) -> Recorded:
    from ludus.record import game_film

    if not (config.policy or config.is_random):
        rate = Fraction(scene.project.ticks_per_second)
        return _film(config, rate, lambda shot: game_film.film_alone(scene, shot))
    rate = Fraction(frames_per_second)

    def opened(engine_args: tuple[str, ...]) -> EnginePool:
        launch = LaunchOptions(
            is_windowed=True, has_debug_view=config.has_overlay, engine_args=engine_args
        )
        return open_pool(game, PoolConfig.of(config, is_pinned=False, launch=launch))

    def take(shot: Shot) -> dict[str, int]:
        seconds = (shot.num_skipped + shot.num_frames) * shot.every / rate
        has_known_steps = game is scene or config.bridge.get("action_repeat") is not None
        known = seconds if has_known_steps else None
        return game_film.film_played(scene, opened, make_player(config), shot, known)

    return _film(config, rate, take)


def _record_pictures(config: RecordConfig, game: Executable) -> Recorded:
    from ludus.record import picture_film

    if not (config.policy or config.is_random):
        raise TargetError(
            f"{game.name} is an exported game, which is filmed only while somebody plays it",
            hint="use --policy or --random with a game made with Bevy; of one made with Godot, "
            "film the project that it was exported from",
        )
    with open_pool(game, PoolConfig.of(config)) as pool:
        return _film(
            config,
            picture_film.picture_rate(pool),
            lambda shot: picture_film.film_pictures(pool, make_player(config), shot),
        )


def _record_environment(config: RecordConfig, target: Gymnasium | Legacy) -> Recorded:
    from ludus.record import gym_film
    from ludus.record.screen import screen

    if config.num_worlds > 1:
        raise ConfigError(
            f"a film of {target.name} shows one environment, not {config.num_worlds}",
            hint="leave num_worlds out",
        )
    with screen(), contextlib.ExitStack() as stack:
        if isinstance(target, Gymnasium):
            env = gym_film.make_rendering(target.env_id, config.max_episode_steps)
        else:
            env = gym_film.make_rendering_game(target, config.bridge, config.max_episode_steps)
        stack.callback(env.close)
        return _film(
            config,
            gym_film.env_rate(env),
            lambda shot: gym_film.film_gymnasium(env, make_player(config), shot),
        )


def _film(
    config: RecordConfig, game_rate: Fraction, take: Callable[[Shot], dict[str, int]]
) -> Recorded:
    """Write the film that ``take`` takes of a game with ``game_rate`` frames a second."""
    out = _out(config)
    rate = choose_rate(check_out(out), game_rate, config.frames_per_second)
    with Film(out, rate, config.width) as film:
        shot = Shot(
            film=film,
            every=int(game_rate / rate),
            num_frames=max(1, round(config.longest * rate)),
            num_episodes=config.num_episodes,
            num_skipped=round(config.start * rate),
            seed=config.seed,
            window=config.window,
            has_overlay=config.has_overlay,
        )
        num_episodes = take(shot)
    return Recorded(out, film.num_frames, rate, num_episodes)
