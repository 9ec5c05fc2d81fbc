"""How many seeds learn a game: `ludus train` once per seed, one after the other.

    python benchmarks/seeds.py --results build/seeds            # the table of docs/training.md
    python benchmarks/seeds.py --games key_door tag --seeds 1 2 3
    python benchmarks/seeds.py path/to/player.tscn --goal 460 --total-steps 300000

Stop it whenever you like: with the same `--results` it goes on with the seeds that are left, and
trains those again whose command has changed. Flags that are not listed by `--help` go to
`ludus train`. Where `ludus` builds games for Bevy, Cargo is needed.
"""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from numpy.typing import NDArray

from ludus.addon import install_addon
from ludus.disk import write_atomically

ROOT = Path(__file__).parents[1]
README_GAME = "path/to/scene.tscn"
NUM_RESAMPLES = 20_000


@dataclass(frozen=True)
class Game:
    """What is trained, and when it counts as learnt.

    Attributes:
        name: Of its row.
        command: What follows `ludus train`.
        goal: Least score of a seed that counts as learnt.
        num_seeds: How many seeds are trained, from 1.
        policy: Whose evaluation is the score; of all policies, the worst one.
        above: If given, the score is the share of episodes with a higher return than this one;
            otherwise it is their mean return.
    """

    name: str
    command: str
    goal: float
    num_seeds: int = 5
    policy: str = ""
    above: float | None = None

    def score(self, evaluation: dict[str, Any]) -> float:
        """Return the score of one seed."""
        of = [evaluation[self.policy]] if self.policy else list(evaluation.values())
        if self.above is None:
            return min(each["mean_return"] for each in of)
        return min(float(np.mean(np.asarray(each["returns"]) > self.above)) for each in of)


GAMES = [
    Game("README's game", f"{README_GAME} --total-steps 300000", 460, 20),
    Game("cartpole", "cartpole --target-return 249", 249, 20),
    Game("godot3:cartpole", "godot3:cartpole --target-return 249", 249, 20),
    Game("bevy:cartpole", "bevy:cartpole --target-return 249", 249, 20),
    Game("pendulum", "pendulum --target-return -200", -250, 20),
    Game(
        "ball_chase",
        "ball_chase --num-worlds 2 --target-return 12 --evaluation-episodes 100",
        11,
        20,
    ),
    Game("key_door", "key_door --target-return 0.95", 0.95),
    Game(
        "tag",
        "tag --league.share 0.5 --league.snapshot-every-updates 5 --total-steps 340000"
        " --evaluation-episodes 200",
        0.9,
        policy="chaser",
        above=0,
    ),
    Game("find_coin", "find_coin --total-steps 6000000", 0.85, policy="hero", above=-60),
    Game("apple_seeker", "apple_seeker --total-steps 1000000", 1.0, above=0),
    Game("godot3:apple_seeker", "godot3:apple_seeker --total-steps 1000000", 1.0, above=0),
    Game("bevy:shooter", "bevy:shooter --num-engines 1 --total-steps 3000000", 3.6),
]


@dataclass(frozen=True)
class Options:
    """What to train, and where results are kept.

    Attributes:
        target: Anything `ludus train` takes, instead of the games of the table.
        goal: Mean return that the evaluation of every policy of target must reach.
        games: Names of the games; all of the table if none is given.
        seeds: Seeds of each game; if none is given, 1 to 20 for short games, 1 to 5 for long ones.
        results: Folder with a file per game and seed.
        only_table: Train nothing; print the table of the results that are there.
    """

    target: tyro.conf.Positional[str] = ""
    goal: float = 0.0
    games: tuple[str, ...] = ()
    seeds: tuple[int, ...] = ()
    results: Path = ROOT / "build" / "seeds"
    only_table: bool = False


def write_readme_game(folder: Path) -> Path:
    """Write the game of README.md as a project; return its scene."""
    found = re.search(r"```gdscript\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    assert found is not None
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "player.gd").write_text(found[1])
    (folder / "project.godot").write_text("config_version=5\n")
    (folder / "player.tscn").write_text("""\
[gd_scene format=3]
[ext_resource path="res://player.gd" type="Script" id="1"]
[ext_resource path="res://addons/ludus/agent/ludus_agent.gd" type="Script" id="2"]
[ext_resource path="res://addons/ludus/agent/ludus_action_component.gd" type="Script" id="3"]
[sub_resource type="Resource" id="1"]
script = ExtResource("3")
[node name="Player" type="CharacterBody2D"]
script = ExtResource("1")
[node name="LudusAgent" type="Node" parent="."]
script = ExtResource("2")
action = Array[ExtResource("3")]([SubResource("1")])
max_episode_steps = 500
""")
    install_addon(folder)
    return folder / "player.tscn"


def train(command: str, seed: int) -> dict[str, Any]:
    """Train in a process of its own; return what the run left."""
    with tempfile.TemporaryDirectory() as folder:
        words = shlex.split(command)
        if words[0] == README_GAME:
            words[0] = str(write_readme_game(Path(folder) / "game"))
        whole = [sys.executable, "-m", "ludus", "train", *words, "--seed", str(seed),
                 "--runs", folder, "--name", "run"]  # fmt: skip
        done = subprocess.run(whole, capture_output=True, text=True, check=False)
        if done.returncode:
            sys.exit(f"{shlex.join(whole)}\n{done.stderr}")
        run = Path(folder) / "run"
        result = json.loads((run / "result.json").read_text())
        return {
            "command": command,
            "agent_steps": result["agent_steps"],
            "seconds": result["wall_s"],
            "evaluation": json.loads((run / "evaluation.json").read_text()),
        }


def result_file(game: Game, seed: int, results: Path) -> Path:
    """Return where the result of one seed is kept."""
    return results / re.sub(r"\W+", "_", game.name) / f"seed-{seed}.json"


def kept_result(game: Game, seed: int, results: Path) -> dict[str, Any] | None:
    """Return the result of one seed, None if there is none of this command."""
    path = result_file(game, seed, results)
    if not path.exists():
        return None
    result = json.loads(path.read_text())
    return result if result["command"] == game.command else None


def train_seeds(game: Game, seeds: tuple[int, ...], results: Path) -> None:
    """Train the seeds that have no result yet, and print a line for each."""
    for seed in seeds:
        result = kept_result(game, seed, results)
        if result is None:
            result = train(game.command, seed)
            path = result_file(game, seed, results)
            path.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(path, json.dumps(result).encode())
        score, steps = game.score(result["evaluation"]), result["agent_steps"]
        mark = "reached" if score >= game.goal else "missed"
        text = f"{game.name}, seed {seed}: {score:.4g}, {mark} after {steps:,} steps"
        print(f"{text} in {result['seconds']:.1f} s", file=sys.stderr, flush=True)


def interquartile_mean(scores: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mean of the middle half of the last axis (Agarwal et al. 2021, rliable)."""
    cut = scores.shape[-1] // 4
    return np.sort(scores, axis=-1)[..., cut : scores.shape[-1] - cut].mean(-1)


def interval(scores: NDArray[np.float64]) -> tuple[float, float]:
    """Return the 95 % bootstrap interval of the interquartile mean.

    As rliable does within one task: runs are drawn anew, with replacement.
    """
    drawn = np.random.default_rng(0).choice(scores, (NUM_RESAMPLES, len(scores)))
    low, high = np.percentile(interquartile_mean(drawn), (2.5, 97.5))
    return float(low), float(high)


def row(game: Game, seeds: tuple[int, ...], results: Path) -> str | None:
    """Return a row of the table in Markdown, or None without results."""
    kept = [kept_result(game, seed, results) for seed in seeds]
    found = [result for result in kept if result is not None]
    if not found:
        return None
    scores = np.array([game.score(result["evaluation"]) for result in found])
    low, high = interval(scores)
    reached = f"{int((scores >= game.goal).sum())} of {len(scores)}"
    steps = np.median([result["agent_steps"] for result in found])
    seconds = np.median([result["seconds"] for result in found])
    mean = f"{float(interquartile_mean(scores)):.4g} ({low:.4g} to {high:.4g})"
    cells = [game.name, f"`ludus train {game.command}`", f"{game.goal:g}", reached, mean]
    return f"| {' | '.join(cells)} | {steps:,.0f} | {seconds:.1f} s |"


def chosen_games(options: Options, flags: list[str]) -> list[Game]:
    """Return what to train."""
    if options.target:
        return [Game(options.target, shlex.join([options.target, *flags]), options.goal, 20)]
    unknown = set(options.games) - {game.name for game in GAMES}
    if unknown or flags:
        sys.exit(f"unknown: {' '.join([*unknown, *flags])}; --games takes "
                 f"{', '.join(repr(game.name) for game in GAMES)}")  # fmt: skip
    return [game for game in GAMES if not options.games or game.name in options.games]


def main() -> None:
    """Train what is left, and print the table."""
    options, flags = tyro.cli(Options, description=__doc__, return_unknown_args=True)
    games = chosen_games(options, flags)
    of = {game: options.seeds or tuple(range(1, game.num_seeds + 1)) for game in games}
    if not options.only_table:
        for game, seeds in of.items():
            train_seeds(game, seeds, options.results)
    print("| game | command | goal | reached | interquartile mean (95 %) | steps | time |")
    print("|---|---|---|---|---|---|---|")
    for game, seeds in of.items():
        line = row(game, seeds, options.results)
        if line is not None:
            print(line)


if __name__ == "__main__":
    main()
