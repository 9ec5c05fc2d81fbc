"""``ludus record``: a film of a game, played by trained agents or as it is."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import tyro

from ludus.cli.action_flags import ActionFlags

__all__ = ["COMMAND", "RecordCommand", "run"]


@dataclass(frozen=True)
class RecordCommand(ActionFlags):
    """Play a game in a window of its own and write a film of it.

    Every frame of the game is taken once, however slowly it is drawn. Where there is no screen,
    Xvfb is started for the time. A run folder plays what was trained there.

    Attributes:
        target: A bundled example, a project folder, a scene, gym:ENV_ID, or a run folder.
        out: File to write: .mp4, .webm or .gif.
        policy: Run folder or checkpoint of trained agents; or policy files (.ludus.json), each
            with its own --policy. Without it the game is filmed as it is.
        random: Take random actions.
        episodes: End after so many episodes of each policy.
        seconds: Length of the film at most; none is 10, with --episodes 600.
        start: Seconds to leave out at the beginning.
        fps: Frames per second of the film; none is half of the game's 60, of a .gif a third.
        width: Width of the film in pixels; none is that of the window.
        window: Width and height of the game's window; none is what the project says.
        scene: Scene of the project; none is the one that was trained, or the main scene.
        seed: Seed of worlds and samples.
        godot: Engine to use; none is the one that ludus finds.
    """

    target: tyro.conf.Positional[str]
    out: Path
    policy: tyro.conf.UseAppendAction[tuple[Path, ...]] = ()
    random: bool = False
    episodes: int | None = None
    seconds: float | None = None
    start: float = 0.0
    fps: float | None = None
    width: int | None = None
    window: tuple[int, int] | None = None
    scene: str | None = None
    seed: int = 0
    godot: Path | None = None


COMMAND = RecordCommand


def run(command: RecordCommand) -> int:
    """Film, say what was written, and return 0."""
    from ludus.record import RecordConfig, record

    recorded = record(
        RecordConfig(
            target=command.target,
            out=command.out,
            policy=command.policy,
            is_random=command.random,
            is_stochastic=bool(command.choose()),
            num_episodes=command.episodes,
            seconds=command.seconds,
            start=command.start,
            frames_per_second=command.fps,
            width=command.width,
            window=command.window,
            scene=command.scene,
            seed=command.seed,
            godot=command.godot,
        )
    )
    words = [
        f"{recorded.num_frames} frames",
        f"{recorded.seconds:.2f} s",
        f"{float(recorded.frames_per_second):g} frames/s",
        *(f"{name}: {count} episodes" for name, count in recorded.num_episodes.items()),
    ]
    sys.stdout.write(f"{recorded.path}: {', '.join(words)}\n")
    return 0
