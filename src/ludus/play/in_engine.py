"""Play a game with trained policies inside it: no connection, the add-on does all."""

from __future__ import annotations

import json
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, cast

from ludus.engine import EngineProcess, GodotFlags, LaunchConfig, resolve_target
from ludus.errors import EngineCrashed, EngineTimeout, GameError
from ludus.play.command_line import play_command
from ludus.play.interactive import OnEpisode, PlayConfig

__all__ = ["play_in_engine"]

EPISODE = "ludus-episode "
"""How the add-on begins a line that reports an episode."""
POLL_S = 0.05
SILENCE_S = 120.0
"""Without a window, how long the game may run without an episode that ends."""
CLOSED_BY_HAND = 0


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
        on_episode: Is told of every episode that ends; of ``num_episodes`` of each policy at most.
        is_stochastic: Whether actions are drawn, rather than the most probable ones.

    Raises:
        TargetError: The target cannot be started.
        EngineCrashed: The game failed, or ended before enough episodes had.
        EngineTimeout: Without a window, no episode ended for two minutes.
        GameError: The game reported an episode in a way that cannot be read.
    """
    target = resolve_target(config.target, scene=config.scene, godot=config.godot)
    flags = GodotFlags(
        headless=config.is_headless,
        fixed_fps=GodotFlags().fixed_fps if config.is_headless else None,
        user_args=_user_args(files, is_stochastic),
    )
    command = play_command(target, flags)
    with tempfile.TemporaryDirectory(prefix="ludus-play-") as folder:
        log = Path(folder) / "game.log"
        with EngineProcess.start(LaunchConfig(command=command, log_path=log)) as process:
            _follow(process, log, _Count(config, list(files), on_episode))


def _user_args(files: Mapping[str, Path], is_stochastic: bool) -> tuple[str, ...]:
    policies = [f"--ludus-policy={name}={path.resolve()}" for name, path in files.items()]
    sample = ["--ludus-sample"] if is_stochastic else []
    return (*policies, *sample, "--ludus-report")


class _Count:
    """Passes episodes on until there are enough of every policy."""

    def __init__(self, config: PlayConfig, policies: list[str], on_episode: OnEpisode) -> None:
        self.is_headless = config.is_headless
        self._wanted = config.num_episodes
        self._policies = policies
        self._on_episode = on_episode
        self._counts: Counter[str] = Counter()

    @property
    def is_complete(self) -> bool:
        """Whether every policy has had its episodes."""
        return self._wanted is not None and all(
            self._counts[name] >= self._wanted for name in self._policies
        )

    def take(self, line: str) -> None:
        """Read what the game reports of one episode."""
        try:
            report = cast(dict[str, Any], json.loads(line))
            policy, value = str(report["policy"]), float(report["return"])
            length = int(report["length"])
        except (ValueError, KeyError, TypeError) as error:
            raise GameError(
                f"the game reported an episode as {line!r}: {type(error).__name__}: {error}",
                hint="its add-on may be of another version: ludus addon install PROJECT",
            ) from None
        if self._wanted is None or self._counts[policy] < self._wanted:
            self._counts[policy] += 1
            self._on_episode(policy, self._counts[policy], value, length)


def _follow(process: EngineProcess, log: Path, count: _Count) -> None:
    """Wait until enough episodes have ended or the game has."""
    lines = _Lines(log)
    heard_at = time.monotonic()
    while True:
        exit_code = process.wait(POLL_S)
        if exit_code is not None:
            process.terminate()  # it has ended; this waits for the rest of its output
        for line in lines.episodes():
            count.take(line)
            heard_at = time.monotonic()
        if count.is_complete:
            return
        if exit_code is not None:
            return _judge_end(process, exit_code, count)
        if count.is_headless and time.monotonic() - heard_at > SILENCE_S:
            raise EngineTimeout(
                f"no episode ended for {SILENCE_S:.0f} s: {process.describe_death()}",
                hint="set max_episode_steps on the agents, so that episodes end",
            )


def _judge_end(process: EngineProcess, exit_code: int, count: _Count) -> None:
    """Accept a window that was closed; nothing else ends by itself."""
    if count.is_headless or exit_code != CLOSED_BY_HAND:
        raise EngineCrashed(
            f"the game ended before its episodes had: {process.describe_death()}",
            process_exit_code=exit_code,
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
