"""Film a trained agent: `python docs/make_film.py RUN docs/cartpole.gif [--seconds 6]`.

Plays the run in a window (under Xvfb where there is no screen), lets Godot write every frame, and
puts the frames together with Pillow, which matplotlib brings along.
"""

from __future__ import annotations

import json
import tempfile
from dataclasses import dataclass
from pathlib import Path

import tyro
from PIL import Image

from ludus.pool import PoolConfig, open_pool
from ludus.session import LaunchOptions
from ludus.train.policy import Player
from ludus.train.saved import load_policies

FRAMES_PER_SECOND = 60
WIDTH = 640
NUM_COLOURS = 96


@dataclass(frozen=True)
class Film:
    """What to film.

    Attributes:
        run: Run folder.
        out: The picture to write, a .gif.
        seconds: Length.
        skip: Show every skip-th frame.
    """

    run: tyro.conf.Positional[Path]
    out: tyro.conf.Positional[Path]
    seconds: float = 6.0
    skip: int = 4


def main(film: Film) -> None:
    """Play, and write the film."""
    config = json.loads((film.run / "config.json").read_text())
    with tempfile.TemporaryDirectory() as folder:
        launch = LaunchOptions(
            is_windowed=True,
            engine_args=("--write-movie", f"{folder}/frame.png", "--resolution", "960x540"),
        )
        with open_pool(config["target"], PoolConfig(scene=config["scene"], launch=launch)) as pool:
            policies = load_policies(film.run, pool.policies)
            players = {
                name: Player(policy, pool.num_agents(name)) for name, policy in policies.items()
            }
            batches = pool.reset(1)
            steps_per_second = pool.spec.tick_rate / pool.spec.ticks_per_step
            for _ in range(int(film.seconds * steps_per_second)):
                batches = pool.step(
                    {name: player.act(batches[name]) for name, player in players.items()}
                )
        frames = sorted(Path(folder).glob("*.png"))[film.skip :: film.skip]
        write_gif([Image.open(frame) for frame in frames], film)


def write_gif(frames: list[Image.Image], film: Film) -> None:
    """Scale the frames down, share one palette among them and write them."""
    small = [frame.convert("RGB").resize((WIDTH, WIDTH * 9 // 16)) for frame in frames]
    palette = small[len(small) // 2].quantize(NUM_COLOURS, Image.Quantize.MAXCOVERAGE)
    pictures = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in small]
    pictures[0].save(
        film.out,
        save_all=True,
        append_images=pictures[1:],
        duration=1000 * film.skip // FRAMES_PER_SECOND,
        loop=0,
        optimize=True,
    )


if __name__ == "__main__":
    main(tyro.cli(Film))
