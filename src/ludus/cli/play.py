"""``ludus play``: a game in a window, played by a trained agent, at random or by hand."""

from __future__ import annotations

import statistics
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from ludus.cli.action_flags import ActionFlags
from ludus.cli.bridge_flags import BridgeFlags
from ludus.locks import TemporaryFolder
from ludus.play.interactive import PlayConfig
from ludus.settings.checks import AT_LEAST_1, optional, setting

if TYPE_CHECKING:
    from ludus.play.episodes import OnEpisode

__all__ = ["COMMAND", "PlayCommand", "run"]

HEADLESS_EPISODES = 10


@dataclass(frozen=True, kw_only=True)
class PlayCommand(BridgeFlags, ActionFlags, PlayConfig):
    """Play a game in a window: with trained agents, at random, or by hand.

    With a run folder, the agents trained there play; with a game, you play, or --random does.
    Close the window or press Ctrl-C to stop. In the window of a Godot 4 game F1 pauses, F2 takes
    one step, F3 slows down to a half, a quarter, an eighth, and back, and F4 shows what an agent
    sees and decides.

    Attributes:
        target: Run folder or checkpoint of trained agents; or a game: a bundled example, a project
            folder, a scene, an exported game, or gym:ENV_ID.
        in_engine: Let the game itself play the trained agents, without Python, as it will when it
            is shipped.
        random: Take random actions.
        num_episodes: End after this many episodes of each policy; if not given, when the window is
            closed, or after ten episodes without a window.
        scene: Scene of the project; if not given, the one that was trained, or the main scene.
        seed: Seed of worlds and samples; with --in-engine, worlds draw their own.
    """

    target: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="TARGET")]
    in_engine: bool = False
    random: bool = False
    num_episodes: Annotated[int | None, tyro.conf.arg(name="episodes")] = setting(
        None, optional(AT_LEAST_1)
    )
    is_headless: Annotated[bool, tyro.conf.arg(name="headless")] = False
    scene: str | None = None


COMMAND = PlayCommand


def run(command: PlayCommand) -> int:
    """Play until the end, and return 0."""
    from ludus.errors import ConfigError
    from ludus.play.interactive import play_by_hand, play_episodes, require_screen
    from ludus.play.players import load_player, random_player
    from ludus.target import check_accepted, find_run, parse_target

    stochastic = command.choose()
    check_accepted("play", parse_target(command.target))
    target = Path(command.target)
    is_trained = find_run(target) is not None
    if command.in_engine and (command.random or not is_trained):
        raise ConfigError(
            "--in-engine needs the trained agents of a run",
            hint="name a run folder, such as runs/cartpole-…, and leave --random out",
        )
    if not command.is_headless:
        require_screen()
    elif not command.random and not is_trained:
        raise ConfigError(
            "a game cannot be played by hand without a window",
            hint="use --random, or name a run folder",
        )
    printer = _Printer()
    config: PlayConfig = command
    if command.is_headless and command.num_episodes is None:
        config = replace(config, num_episodes=HEADLESS_EPISODES)
    if is_trained:
        config = _as_trained(config)
    if command.in_engine:
        _play_in_engine(config, target, printer.show, is_stochastic=bool(stochastic))
    elif command.random:
        play_episodes(config, lambda pool: random_player(pool, command.seed), printer.show)
    elif is_trained:
        play_episodes(
            config, lambda pool: load_player([target], pool, command.seed, stochastic), printer.show
        )
    else:
        play_by_hand(config)
    printer.show_means()
    return 0


def _as_trained(config: PlayConfig) -> PlayConfig:
    """Return the settings with what the run that is the target was trained with."""
    from ludus.runs.saved import trained_config

    names = ("scene", "ticks_per_step", "max_episode_steps", "godot", "token_file")
    typed = {name: getattr(config, name) for name in names}
    trained = trained_config(Path(config.target), **typed)
    return replace(config, **{name: getattr(trained, name) for name in ("target", *names)})


def _play_in_engine(
    config: PlayConfig, run_folder: Path, on_episode: OnEpisode, *, is_stochastic: bool
) -> None:
    """Export the agents to a temporary folder, and let the game play them."""
    from ludus.export.exporting import write_policies
    from ludus.play.in_engine import play_in_engine

    for name in ("ticks_per_step", "max_episode_steps"):
        if (value := getattr(config, name)) is not None:
            text = f"trained with {name} {value}; in the engine, the agents' own setting applies"
            sys.stderr.write(f"warning: {text}\n")
    with TemporaryFolder("policies") as temporary:
        files = write_policies(run_folder, temporary.path)
        play_in_engine(config, files, on_episode, is_stochastic=is_stochastic)


class _Printer:
    """Prints each episode that ends, and in the end the mean of each policy."""

    def __init__(self) -> None:
        self._returns: dict[str, list[float]] = {}

    def show(self, policy: str, number: int, episode_return: float, length: int) -> None:
        self._returns.setdefault(policy, []).append(episode_return)
        self._say(f"{policy}: episode {number}, return {episode_return:.6g} in {length} steps")

    def show_means(self) -> None:
        for policy, returns in self._returns.items():
            mean = statistics.fmean(returns)
            self._say(f"{policy}: mean return {mean:.6g} of {len(returns)} episodes")

    def _say(self, text: str) -> None:
        sys.stdout.write(f"{text}\n")
        sys.stdout.flush()
