"""``ludus play``: a game in a window, played by a trained agent, at random or by hand."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

if TYPE_CHECKING:
    from ludus.play.interactive import Act, OnEpisode, PlayConfig, Player
    from ludus.pool import EnginePool

__all__ = ["COMMAND", "PlayCommand", "run"]

HEADLESS_EPISODES = 10


@dataclass(frozen=True)
class PlayCommand:
    """Play a game in a window: with trained agents, at random, or by hand.

    A run folder plays what was trained there. A game is played by hand, or at random with --random.
    Close the window or press Ctrl-C to end.

    Attributes:
        what: Run folder or checkpoint of trained agents; or a game: a bundled example, a project
            folder, a scene, or an exported game.
        in_engine: Let the game play the trained agents itself, without Python, as it will when it
            is shipped.
        random: Take random actions.
        stochastic: Draw actions as in training, instead of taking the most probable ones.
        deterministic: Take the most probable actions; this is the default.
        episodes: End after so many episodes of each policy; none plays until the window is closed,
            without a window ten.
        headless: Open no window, play as fast as possible and print the returns.
        scene: Scene of the project; none is the one that was trained, or the main scene.
        seed: Seed of worlds and samples; in the engine, worlds draw their own.
        godot: Engine to use; none is the one that ludus finds.
    """

    what: tyro.conf.Positional[str]
    in_engine: bool = False
    random: bool = False
    stochastic: bool = False
    deterministic: bool = False
    episodes: int | None = None
    headless: bool = False
    scene: str | None = None
    seed: int = 0
    godot: Path | None = None


COMMAND = PlayCommand


def run(command: PlayCommand) -> int:
    """Play until the end, and return 0."""
    from ludus.play.interactive import PlayConfig, play_by_hand, require_screen

    _check(command)
    if not command.headless:
        require_screen()
    config = PlayConfig(
        target=command.what,
        scene=command.scene,
        seed=command.seed,
        is_headless=command.headless,
        num_episodes=command.episodes or (HEADLESS_EPISODES if command.headless else None),
        godot=command.godot,
    )
    run_folder = _run_folder(command.what)
    if run_folder is None and not command.random:
        play_by_hand(config)
        return 0
    if command.in_engine:
        assert run_folder is not None
        _play_in_engine(_as_trained(config, run_folder, command.scene), command, run_folder)
    else:
        _play(config, command, run_folder)
    return 0


def _check(command: PlayCommand) -> None:
    from ludus.errors import ConfigError

    if command.stochastic and command.deterministic:
        raise ConfigError("--stochastic and --deterministic exclude each other")
    if command.episodes is not None and command.episodes < 1:
        raise ConfigError(f"episodes must be at least 1, not {command.episodes}")
    if command.in_engine and (command.random or _run_folder(command.what) is None):
        raise ConfigError(
            "--in-engine plays what was trained in a run",
            hint="name a run folder, such as runs/cartpole-…, and leave --random out",
        )
    if command.headless and not command.random and _run_folder(command.what) is None:
        raise ConfigError(
            "nobody can play by hand without a window",
            hint="use --random, or name a run folder",
        )


def _run_folder(what: str) -> Path | None:
    """Return the run or checkpoint that ``what`` names, or None if it names a game."""
    path = Path(what)
    if not path.is_dir() or (path / "project.godot").is_file():
        return None
    homes = (path, path.resolve().parent.parent)
    return path if any((home / "config.json").is_file() for home in homes) else None


def _play(config: PlayConfig, command: PlayCommand, run_folder: Path | None) -> None:
    from ludus.play.interactive import play_episodes, random_player

    player: Player = random_player
    if run_folder is not None:
        config = _as_trained(config, run_folder, command.scene)
        if not command.random:
            player = _trained_player(run_folder, is_stochastic=command.stochastic)
    play_episodes(config, player, _printer())


def _play_in_engine(config: PlayConfig, command: PlayCommand, run_folder: Path) -> None:
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
        play_in_engine(config, files, _printer(), is_stochastic=command.stochastic)


def _printer() -> OnEpisode:
    from rich.console import Console

    console = Console()

    def show(policy: str, number: int, episode_return: float, length: int) -> None:
        console.print(
            f"{policy}: episode {number}, return {episode_return:.6g} in {length} steps",
            highlight=False,
        )

    return show


def _trained_player(run_folder: Path, *, is_stochastic: bool) -> Player:
    """Act as the agents of a run would."""
    import torch

    from ludus.algorithms.learners import policy_seed
    from ludus.networks.policy import Player as PolicyPlayer
    from ludus.runs.saved import load_policies

    def player(pool: EnginePool, seed: int) -> Act:
        policies = load_policies(run_folder, pool.policies)
        draws = {
            name: torch.Generator().manual_seed(policy_seed(seed, name)) if is_stochastic else None
            for name in policies
        }
        players = {
            name: PolicyPlayer(policy, pool.num_agents(name), draws[name])
            for name, policy in policies.items()
        }
        return lambda _, batches: {
            name: player.act(batches[name]) for name, player in players.items()
        }

    return player


def _as_trained(config: PlayConfig, run_folder: Path, scene: str | None) -> PlayConfig:
    from ludus.runs.run_folder import RunFolder

    trained = RunFolder.find(run_folder).read_config()
    return replace(
        config,
        target=trained.target,
        scene=scene or trained.scene,
        ticks_per_step=trained.ticks_per_step,
        max_episode_steps=trained.max_episode_steps,
        godot=config.godot or trained.godot,
    )
