"""Film a Godot game in a window."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from fractions import Fraction

from ludus.engine import (
    EngineProcess,
    GodotFlags,
    LaunchConfig,
    ensure_imported,
    godot_command,
)
from ludus.engine.find import InstalledEngine
from ludus.errors import EngineCrashed, EngineError, EngineTimeout, SetupError
from ludus.play.episodes import EpisodeCounter
from ludus.play.players import MakePlayer
from ludus.play.playing import Play
from ludus.play.watched import WatchedPlayer
from ludus.pool import EnginePool
from ludus.pool.interface import Pool
from ludus.record.camera import Camera
from ludus.record.film import Frame
from ludus.record.screen import screen, variables
from ludus.record.shot import Shot
from ludus.session.opening import DEBUG_VIEW
from ludus.target import Scene

__all__ = ["film_alone", "film_played"]

CONNECT_S = 60.0
SILENCE_S = 120.0
"""How long a game that nobody plays may take for a frame."""

OpenGame = Callable[[tuple[str, ...]], EnginePool]
"""From further arguments for the engine to its game, opened in a window."""

_POLL_S = 0.05
_NO_RENDERER = ("Display is not available", "Your video card", "Unable to create", "GLX", "EGL")


def film_played(
    scene: Scene, opened: OpenGame, player: MakePlayer, shot: Shot, seconds: Fraction | None
) -> dict[str, int]:
    """Film a game that Python plays; return how many episodes of each policy have ended.

    The first frame shows the game after the first ticks of the first step.

    Args:
        scene: What is played.
        opened: Starts it in a window.
        player: From the pool to the way to act in it.
        shot: What is taken.
        seconds: Game time to play; None where the pool does not know how long a step takes: until
            the frames are here, so that more episodes may be counted than the film shows.

    Raises:
        EngineError: The game failed.
        RunError: The film could not be written.
        SetupError: There is no screen, or nothing to draw with.
    """
    engine = _engine_of(scene)
    with _camera(shot) as camera, _hint_at_renderer(engine):
        with opened(_engine_args(engine, shot)) as pool:
            camera.connect(CONNECT_S, lambda: None)
            counter = EpisodeCounter(pool.policies, shot.num_episodes)
            play = Play(pool, WatchedPlayer(pool, player(pool)), shot.seed)
            camera.begin()
            play.run(counter, _is_full(camera, pool, seconds))
            camera.end()
            play.step()
            camera.finish()
        return dict(counter.num_episodes)


def film_alone(scene: Scene, shot: Shot) -> dict[str, int]:
    """Film a game that plays itself, or that nobody plays; no episode is counted.

    Raises:
        LudusError: As :func:`film_played`.
    """
    engine = _engine_of(scene)
    ensure_imported(engine, scene.project)
    flags = GodotFlags(
        headless=False,
        fixed_fps=scene.project.ticks_per_second,
        engine_args=_engine_args(engine, shot),
        user_args=(DEBUG_VIEW,) if shot.has_overlay else (),
    )
    command = godot_command(engine, scene.project.root, scene.path, flags)
    with (
        _camera(shot) as camera,
        _hint_at_renderer(engine),
        EngineProcess.start(LaunchConfig(command=command)) as process,
    ):
        camera.connect(CONNECT_S, lambda: _check_alive(process))
        camera.begin()
        _await_film(camera, process)
    return {}


@contextmanager
def _camera(shot: Shot) -> Generator[Camera]:
    """Give a camera, a screen, and what a game must know of both."""
    skipped = iter(range(shot.num_skipped))

    def take(frame: Frame) -> None:
        if next(skipped, None) is None:
            shot.film.add(frame)

    camera = Camera(take, shot.every, shot.num_skipped + shot.num_frames)
    with contextlib.closing(camera), screen(), variables(camera.variable):
        try:
            yield camera
        except EngineError:
            camera.check()  # a film that cannot be written ends the game, too
            raise


@contextmanager
def _hint_at_renderer(engine: InstalledEngine) -> Generator[None]:
    """Say how to install a renderer, where the game could not draw."""
    try:
        yield
    except EngineError as error:
        if any(sign in error.message for sign in _NO_RENDERER):
            raise SetupError(
                f"{engine.path} could not draw: {error.message}",
                hint=f"ludus engine install {engine.kind} --rendering",
            ) from error
        raise


def _engine_of(scene: Scene) -> InstalledEngine:
    engine = scene.find_engine()
    if "server" in engine.executable(headless=False).name:
        raise SetupError(
            f"{engine.path} has no renderer",
            hint=f"ludus engine install {engine.kind} --rendering, or name another one with "
            "--godot",
        )
    return engine


def _engine_args(engine: InstalledEngine, shot: Shot) -> tuple[str, ...]:
    arguments = Camera.engine_args(engine.kind)
    if shot.window is None:
        return arguments
    width, height = shot.window
    return (*arguments, "--resolution", f"{width}x{height}")


def _is_full(camera: Camera, pool: Pool, seconds: Fraction | None) -> Callable[[], bool]:
    """Return what tells whether enough has been played; the frames may still be on their way."""
    first, rate = pool.times(0).tick, Fraction(pool.spec.tick_rate).limit_denominator(1000)

    def is_full() -> bool:
        camera.check()
        if seconds is None:
            return camera.is_full
        return (pool.times(0).tick - first) / rate >= seconds

    return is_full


def _await_film(camera: Camera, process: EngineProcess) -> None:
    num_frames, since = 0, time.monotonic()
    while not camera.is_full:
        camera.check()
        time.sleep(_POLL_S)
        if camera.num_frames > num_frames:
            num_frames, since = camera.num_frames, time.monotonic()
        elif time.monotonic() - since > SILENCE_S:
            raise EngineTimeout(f"the game drew no frame for {SILENCE_S:g} s")
        else:
            _check_alive(process)


def _check_alive(process: EngineProcess) -> None:
    if (code := process.poll()) is not None:
        raise EngineCrashed(
            f"the game ended before the film was complete: {process.describe_death()}",
            process_exit_code=code,
        )
