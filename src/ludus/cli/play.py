"""``ludus play``: a game in a window, played by a trained agent, at random or by hand."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from ludus.cli.action_flags import ActionFlags

if TYPE_CHECKING:
    from ludus.play.episodes import OnEpisode
    from ludus.play.interactive import PlayConfig

__all__ = ["COMMAND", "PlayCommand", "run"]

HEADLESS_EPISODES = 10


@dataclass(frozen=True)
class PlayCommand(ActionFlags):
    """Play a game in a window: with trained agents, at random, or by hand.

    A run folder plays what was trained there. A game is played by hand, or at random with --random.
    Close the window or press Ctrl-C to end.

    Attributes:
        target: Run folder or checkpoint of trained agents; or a game: a bundled example, a project
            folder, a scene, or an exported game.
        in_engine: Let the game play the trained agents itself, without Python, as it will when it
            is shipped.
        random: Take random actions.
        episodes: End after so many episodes of each policy; none plays until the window is closed,
            without a window ten.
        headless: Open no window, play as fast as possible and print the returns.
        scene: Scene of the project; none is the one that was trained, or the main scene.
        seed: Seed of worlds and samples; in the engine, worlds draw their own.
        godot: Engine to use; none is the one that ludus finds.
        token_file: File with the token of a game that listens on another machine.
    """

    target: tyro.conf.Positional[str]
    in_engine: bool = False
    random: bool = False
    episodes: int | None = None
    headless: bool = False
    scene: str | None = None
    seed: int = 0
    godot: Path | None = None
    token_file: Path | None = None


COMMAND = PlayCommand


def run(command: PlayCommand) -> int:
    """Play until the end, and return 0."""
    from ludus.errors import ConfigError
    from ludus.play.interactive import PlayConfig, play_by_hand, play_episodes, require_screen
    from ludus.play.players import load_player, random_player
    from ludus.target import find_run

    target = Path(command.target)
    is_trained = find_run(target) is not None
    stochastic = command.choose()
    if command.episodes is not None and command.episodes < 1:
        raise ConfigError(f"episodes must be at least 1, not {command.episodes}")
    if command.in_engine and (command.random or not is_trained):
        raise ConfigError(
            "--in-engine plays what was trained in a run",
            hint="name a run folder, such as runs/cartpole-…, and leave --random out",
        )
    if not command.headless:
        require_screen()
    elif not command.random and not is_trained:
        raise ConfigError(
            "nobody can play by hand without a window",
            hint="use --random, or name a run folder",
        )
    config = PlayConfig(
        target=command.target,
        scene=command.scene,
        seed=command.seed,
        is_headless=command.headless,
        num_episodes=command.episodes or (HEADLESS_EPISODES if command.headless else None),
        godot=command.godot,
        token_file=command.token_file,
    )
    if is_trained:
        config = _as_trained(config)
    if command.in_engine:
        _play_in_engine(config, target, is_stochastic=bool(stochastic))
    elif command.random:
        play_episodes(config, lambda pool: random_player(pool, command.seed), _printer())
    elif is_trained:
        play_episodes(
            config, lambda pool: load_player([target], pool, command.seed, stochastic), _printer()
        )
    else:
        play_by_hand(config)
    return 0


def _as_trained(config: PlayConfig) -> PlayConfig:
    """Return the settings with what the run that is the target was trained with."""
    from ludus.runs.saved import trained_config

    trained = trained_config(Path(config.target), scene=config.scene, godot=config.godot)
    names = ("target", "scene", "ticks_per_step", "max_episode_steps", "godot")
    return replace(config, **{name: getattr(trained, name) for name in names})


def _play_in_engine(config: PlayConfig, run_folder: Path, *, is_stochastic: bool) -> None:
    """Export the agents to a temporary folder, and let the game play them."""
    import tempfile

    from ludus.export.exporting import write_policies
    from ludus.play.in_engine import play_in_engine

    for name in ("ticks_per_step", "max_episode_steps"):
        if (value := getattr(config, name)) is not None:
            text = f"trained with {name} {value}; in the engine the agents' own holds"
            sys.stderr.write(f"warning: {text}\n")
    with tempfile.TemporaryDirectory(prefix="ludus-policies-") as folder:
        files = write_policies(run_folder, Path(folder))
        play_in_engine(config, files, _printer(), is_stochastic=is_stochastic)


def _printer() -> OnEpisode:
    from rich.console import Console

    console = Console()

    def show(policy: str, number: int, episode_return: float, length: int) -> None:
        console.print(
            f"{policy}: episode {number}, return {episode_return:.6g} in {length} steps",
            highlight=False,
        )

    return show
