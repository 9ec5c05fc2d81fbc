"""Play a game with trained policies inside it: no connection, the add-on does all."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, cast

from ludus.engine import EngineProcess, GodotFlags, LaunchConfig
from ludus.errors import EngineCrashed, EngineTimeout, GameError
from ludus.locks import TemporaryFolder
from ludus.play.command_line import play_command
from ludus.play.episodes import EpisodeCounter, OnEpisode
from ludus.play.interactive import CLOSED_BY_HAND, CONTROLS, PlayConfig
from ludus.target import check_accepted, parse_target
from ludus.wire.godot_json import parse_godot_json

__all__ = ["play_in_engine"]

EPISODE = "ludus-episode "
"""How the add-on begins a line that reports an episode."""
POLL_S = 0.05
SILENCE_S = 120.0
"""Without a window, how long the game may run without an episode that ends."""


def play_in_engine(
    config: PlayConfig,
    files: Mapping[str, Path],
    on_episode: OnEpisode,
    *,
    is_stochastic: bool = False,
) -> None:
    """Start a game that plays policies itself, until enough episodes ended or it is closed.

    Args:
        config: What to play, and how it is shown.
        files: A ``.ludus.json`` for each policy, by name.
        on_episode: Gets every episode that ends, ``num_episodes`` of each policy at most.
        is_stochastic: Whether actions are drawn, rather than the most probable ones.

    Raises:
        TargetError: The target cannot be started.
        EngineCrashed: The game failed, or ended before enough episodes had.
        EngineTimeout: Without a window, no episode ended for two minutes.
        GameError: The game reported an episode in a way that cannot be read.
    """
    target = parse_target(config.target, scene=config.scene, godot=config.godot)
    check_accepted("play", target)
    flags = GodotFlags(
        headless=config.is_headless,
        fixed_fps=GodotFlags().fixed_fps if config.is_headless else None,
        user_args=(*_user_args(files, is_stochastic), *(() if config.is_headless else CONTROLS)),
    )
    command = play_command(target, flags)
    with TemporaryFolder("play") as temporary:
        log = temporary.path / "game.log"
        with EngineProcess.start(LaunchConfig(command=command, log_path=log)) as process:
            counter = EpisodeCounter(files, config.num_episodes, on_episode)
            _follow(process, log, counter, is_headless=config.is_headless)


def _user_args(files: Mapping[str, Path], is_stochastic: bool) -> tuple[str, ...]:
    policies = [f"--ludus-policy={name}={path.resolve()}" for name, path in files.items()]
    sample = ["--ludus-sample"] if is_stochastic else []
    return (*policies, *sample, "--ludus-report")


def _read_report(line: str) -> tuple[str, float, int]:
    """Return policy, return and length of an episode that the game reported."""
    try:
        report = cast(dict[str, Any], parse_godot_json(line.encode()))
        policy, total, length = str(report["policy"]), report["return"], int(report["length"])
        # Rust, and Godot since 4.5, write null for NaN.
        episode_return = math.nan if total is None else float(total)
    except (ValueError, KeyError, TypeError) as error:
        raise GameError(
            f"the game reported an episode as {line!r}: {type(error).__name__}: {error}",
            hint="its add-on may be of another version: ludus addon install PROJECT",
        ) from None
    if not math.isfinite(episode_return):
        raise GameError(
            f"{policy}: an episode of {length} steps has the return {episode_return}",
            hint="a reward was NaN or infinite: look for a division by zero in the game's script",
        )
    return policy, episode_return, length


def _follow(
    process: EngineProcess, log: Path, counter: EpisodeCounter, *, is_headless: bool
) -> None:
    """Wait until enough episodes have ended or the game has."""
    lines = _Lines(log)
    heard_at = time.monotonic()
    while True:
        exit_code = process.wait(POLL_S)
        if exit_code is not None:
            process.terminate()  # it has ended; this waits for the rest of its output
        for line in lines.episodes():
            counter.add(*_read_report(line))
            heard_at = time.monotonic()
        if counter.is_complete:
            return
        if exit_code is not None:
            if not is_headless and exit_code == CLOSED_BY_HAND:
                return
            raise EngineCrashed(
                f"the game ended before its episodes had: {process.describe_death()}",
                process_exit_code=exit_code,
            )
        if is_headless and time.monotonic() - heard_at > SILENCE_S:
            raise EngineTimeout(
                f"no episode ended for {SILENCE_S:.0f} s: {process.describe_death()}",
                hint="set max_episode_steps on the agents, so that episodes end",
            )


class _Lines:
    """Reads a growing file, line by line."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._position = 0
        self._partial = b""

    def episodes(self) -> Iterator[str]:
        """Yield what new lines report of episodes."""
        try:
            with self._path.open("rb") as file:
                file.seek(self._position)
                data = file.read()
        except FileNotFoundError:
            return
        self._position += len(data)
        *lines, self._partial = (self._partial + data).split(b"\n")
        for line in lines:
            text = line.decode(errors="replace").rstrip("\r")
            if text.startswith(EPISODE):
                yield text.removeprefix(EPISODE)
