"""Film a trained agent: `python docs/make_film.py RUN docs/cartpole.gif [--seconds 6]`.

Plays the run in a window (under Xvfb where there is no screen), lets Godot write every frame, and
puts the frames together with Pillow, which matplotlib brings along. In the place of a run, a scene
whose agents have policies of their own plays itself:
`python docs/make_film.py engines/godot4/examples/find_coin/trained.tscn docs/find_coin.gif`.
"""

from __future__ import annotations

import json
import tempfile
from dataclasses import dataclass
from pathlib import Path

import tyro
from PIL import Image

from ludus.engine import (
    EngineProcess,
    GodotFlags,
    LaunchConfig,
    ensure_imported,
    find_engine,
    godot_command,
    with_display,
)
from ludus.engine.project import find_project, scene_path
from ludus.pool import PoolConfig, open_pool
from ludus.session import LaunchOptions
from ludus.train.policy import Player
from ludus.train.saved import load_policies

FRAMES_PER_SECOND = 60
WIDTH = 640
NUM_COLOURS = 96
TIMEOUT_S = 600.0


@dataclass(frozen=True)
class Film:
    """What to film.

    Attributes:
        target: Run folder, or a scene.
        out: The picture to write, a .gif.
        seconds: Length.
        skip: Show every skip-th frame.
        start: Seconds to leave out at the beginning; of a scene only.
    """

    target: tyro.conf.Positional[Path]
    out: tyro.conf.Positional[Path]
    seconds: float = 6.0
    skip: int = 4
    start: float = 0.0


def main(film: Film) -> None:
    """Play, and write the film."""
    with tempfile.TemporaryDirectory() as folder:
        recording = ("--write-movie", f"{folder}/frame.png", "--resolution", "960x540")
        if film.target.suffix == ".tscn":
            film_scene(film, recording)
        else:
            film_run(film, recording)
        first = round(film.start * FRAMES_PER_SECOND) + film.skip
        frames = sorted(Path(folder).glob("*.png"))[first :: film.skip]
        write_gif([Image.open(frame) for frame in frames], film)


def film_run(film: Film, recording: tuple[str, ...]) -> None:
    """Play a run from Python."""
    config = json.loads((film.target / "config.json").read_text())
    launch = LaunchOptions(is_windowed=True, engine_args=recording)
    with open_pool(config["target"], PoolConfig(scene=config["scene"], launch=launch)) as pool:
        policies = load_policies(film.target, pool.policies)
        players = {name: Player(policy, pool.num_agents(name)) for name, policy in policies.items()}
        batches = pool.reset(1)
        steps_per_second = pool.spec.tick_rate / pool.spec.ticks_per_step
        for _ in range(int(film.seconds * steps_per_second)):
            batches = pool.step(
                {name: player.act(batches[name]) for name, player in players.items()}
            )


def film_scene(film: Film, recording: tuple[str, ...]) -> None:
    """Let a scene play itself."""
    project = find_project(film.target)
    engine = find_engine(project.engine_kind)
    ensure_imported(engine, project)
    num_frames = round((film.start + film.seconds) * FRAMES_PER_SECOND)
    flags = GodotFlags(
        headless=False,
        fixed_fps=None,
        engine_args=(*recording, "--quit-after", str(num_frames), "--audio-driver", "Dummy"),
    )
    scene = scene_path(project, film.target)
    command = with_display(godot_command(engine, project.root, scene, flags))
    with EngineProcess.start(LaunchConfig(command=command)) as process:
        process.wait(TIMEOUT_S)


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
