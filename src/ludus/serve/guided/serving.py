"""Serve one game after the other, and clean up when one goes."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Generator
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from ludus.disk import disk_errors
from ludus.errors import EngineCrashed, EngineStartError, LudusError
from ludus.networks.device import choose_device
from ludus.pool.engine_pool import EnginePool
from ludus.pool.opening import spin_us_beside
from ludus.serve.guided.game_run import game_config, opened_run
from ludus.serve.guided.game_server import ConnectedGame, GameServer
from ludus.serve.guided.guidance import Game, Guidance
from ludus.session import GuidedSession
from ludus.session.supervision import Supervision
from ludus.session.user_token import user_token
from ludus.settings.train_config import TrainConfig
from ludus.wire.handshake import EngineConfig

__all__ = ["GuidedConfig", "serve_guided"]

POLL_S = 0.2

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class GuidedConfig:
    """Settings of ``ludus serve``.

    Attributes:
        port: TCP port on the loopback address; 0: any free one.
        runs: Folder of the runs.
        policies: Folder for exported policies; None: ``policies`` in the run's folder.
        is_once: End when the first game has disconnected.
        seed: Seed of new runs whose game names none; None: random.
        device: PyTorch device, or ``auto``.
        torch_threads: Threads that PyTorch may use.
        hello_timeout_s: How long a greeting may take, seconds.
        first_game_timeout_s: With ``is_once``, how long to wait for a game, seconds.
        start_timeout_s: How long a game may take to create its worlds, seconds.
        step_timeout_s: How long an answer may take, seconds.
    """

    port: int = 11011
    runs: Path = Path("runs")
    policies: Path | None = None
    is_once: bool = False
    seed: int | None = None
    device: str = "auto"
    torch_threads: int = 1
    hello_timeout_s: float = 10.0
    first_game_timeout_s: float = 60.0
    start_timeout_s: float = 60.0
    step_timeout_s: float = 60.0


def serve_guided(
    config: GuidedConfig, is_stopping: Callable[[], bool], on_ready: Callable[[int], None]
) -> None:
    """Serve games until ``is_stopping``, or with ``is_once`` until the first has disconnected.

    Args:
        config: How to serve.
        is_stopping: Called often, in this thread.
        on_ready: Called with the port once games can connect.

    Raises:
        SetupError: The port is taken, or this user's token cannot be kept.
        ConfigError: A setting is not valid.
        RunError: The folder of the runs cannot be created.
        EngineStartError: With ``is_once``, no game connected.
        LudusError: With ``is_once``, what went wrong with the game; not that it disconnected.
    """
    choose_device(_settings(config).device)
    torch.set_num_threads(config.torch_threads)
    with disk_errors(f"the folder of the runs, {config.runs}"):
        config.runs.mkdir(parents=True, exist_ok=True)
    token, timeout_s = user_token(), config.hello_timeout_s
    with GameServer(config.port, token, timeout_s, config.start_timeout_s) as server:
        on_ready(server.port)
        _serve_all(server, config, is_stopping)


def _serve_all(server: GameServer, config: GuidedConfig, is_stopping: Callable[[], bool]) -> None:
    deadline = time.monotonic() + config.first_game_timeout_s
    while not is_stopping():
        game = server.accept(POLL_S)
        if game is not None:
            try:
                was_served = _serve_one(game, config, is_stopping)
            finally:
                server.release()
            if was_served and config.is_once:
                return
        elif config.is_once and time.monotonic() > deadline:
            raise EngineStartError(
                f"no game connected within {config.first_game_timeout_s:g} s",
                "without --once, ludus serve waits indefinitely",
            )


def _serve_one(game: ConnectedGame, config: GuidedConfig, is_stopping: Callable[[], bool]) -> bool:
    """Serve a game until it disconnects; errors are reported to it, and logged.

    Returns:
        Whether it sent its spec.

    Raises:
        Exception: With ``is_once``, what went wrong, unless the game simply disconnected.
    """
    hello = game.greeting.hello
    assert hello is not None, "it has proved itself"
    log.info("%s connected: %s, add-on %s", game.name, hello.engine, hello.addon)
    was_served = False
    try:
        with closing(_open_session(game, config)) as session:
            was_served = True
            _train(session, game, config, is_stopping)
    except EngineCrashed as error:
        log.info("%s disconnected: %s", game.name, error.message)
    except Exception as error:
        if config.is_once:
            raise
        is_known = isinstance(error, LudusError)
        log.error("%s: %s", game.name, error, exc_info=None if is_known else error)
    else:
        log.info("%s: the session has ended", game.name)
    return was_served


def _open_session(game: ConnectedGame, config: GuidedConfig) -> GuidedSession:
    engine = EngineConfig(num_worlds=game.training.num_worlds, spin_us=spin_us_beside(1))
    timeout_s = config.step_timeout_s
    return GuidedSession(game.link, engine, Supervision(None), game.greeting, timeout_s)


def _train(
    session: GuidedSession,
    game: ConnectedGame,
    config: GuidedConfig,
    is_stopping: Callable[[], bool],
) -> None:
    pool = EnginePool(lambda _: session)
    wanted = game.training
    settings = replace(
        _settings(config),
        seed=config.seed if wanted.seed is None else wanted.seed,
        keep_every_updates=wanted.checkpoint_every_updates,
    )
    with (
        _reporting_errors_to(session),
        opened_run(game_config(settings, wanted.run, pool), pool) as run,
    ):
        guidance = Guidance(Game(session, pool), run, config.policies)
        with _reporting_errors_to(session):  # before the run is written, which takes time
            run.stop_reason = guidance.conduct(is_stopping)
            session.close()


def _settings(config: GuidedConfig) -> TrainConfig:
    return TrainConfig(
        seed=config.seed,
        runs=config.runs,
        device=config.device,
        torch_threads=config.torch_threads,
    )


@contextmanager
def _reporting_errors_to(session: GuidedSession) -> Generator[None, None, None]:
    """Report an error to the game; does nothing if the session has ended with that error."""
    try:
        yield
    except LudusError as error:
        session.fail(error)
        raise
    except Exception as error:
        session.fail(LudusError(f"a defect of ludus serve: {type(error).__name__}: {error}"))
        raise
