"""A game that shows how many ticks have passed since its reset, as eight bars: a byte, bit by bit.

The same for Godot 4 and for Godot 3, and as a Gymnasium environment.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

import av
import gymnasium
import numpy as np
from numpy.typing import NDArray

from tests.godot_project import AGENT_SCENE, write_project

WIDTH, HEIGHT = 320, 180
NUM_BARS = 8
STEPS = 20
"""Of an episode; two ticks each."""

SIZES = {
    "godot4": "[display]\n\nwindow/size/viewport_width=320\nwindow/size/viewport_height=180\n",
    "godot3": "[display]\n\nwindow/size/width=320\nwindow/size/height=180\n",
}

SCRIPT = """\
extends Node2D
var ticks = 0
var bars = []
func _ready():
	for i in 8:
		var bar = ColorRect.new()
		bar.{position} = Vector2(i * 40, 0)
		bar.{size} = Vector2(40, 180)
		add_child(bar)
		bars.append(bar)
	show_ticks()
func _physics_process(_delta):
	ticks += 1
	show_ticks()
func show_ticks():
	for i in 8:
		bars[i].color = Color(1, 1, 1) if ticks & (1 << i) else Color(0, 0, 0)
func apply_action(_action):
	if OS.get_environment("TICKS_DIE") != "" and ticks == 9:
		OS.kill(OS.get_process_id())
func get_observation():
	{server}.force_draw()
	return [ticks]
func get_reward():
	return 1.0
func is_done():
	return ticks >= 40
func reset():
	ticks = 0
	show_ticks()
"""
NAMES = {
    "godot4": {"server": "RenderingServer", "position": "position", "size": "size"},
    "godot3": {"server": "VisualServer", "position": "rect_position", "size": "rect_size"},
}


def ticks_project(folder: Path, kind: str) -> Path:
    """Make the project for one kind of engine."""
    files = {
        "ticks.gd": SCRIPT.format(**NAMES[kind]),
        "ticks.tscn": AGENT_SCENE[kind].format(script="ticks", root="Node2D"),
    }
    return write_project(folder, files, main="ticks", kind=kind, more=SIZES[kind])


def draw(ticks: int) -> NDArray[np.uint8]:
    """Return the picture that shows ``ticks``."""
    bits = np.array([ticks >> i & 1 for i in range(NUM_BARS)], np.uint8)
    row = np.repeat(bits * 255, WIDTH // NUM_BARS)
    return np.repeat(np.tile(row, (HEIGHT, 1))[:, :, None], 3, axis=2)


def read_ticks(film: Path) -> list[int]:
    """Return what each frame of a film shows."""
    return [_ticks_of(frame) for frame in frames_of(film)]


def frames_of(film: Path) -> list[NDArray[np.uint8]]:
    """Return all frames of a film."""
    with av.open(str(film)) as container:
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
        return cast("list[NDArray[np.uint8]]", frames)


def times_of(film: Path) -> list[float]:
    """Return when each frame is shown, seconds."""
    with av.open(str(film)) as container:
        return [float(frame.time or 0.0) for frame in container.decode(video=0)]


def _ticks_of(frame: NDArray[np.uint8]) -> int:
    width = frame.shape[1] // NUM_BARS
    row = frame[frame.shape[0] // 2, :, 0]
    bits = [int(row[i * width + width // 2] > 127) for i in range(NUM_BARS)]
    return sum(bit << i for i, bit in enumerate(bits))


class Ticks(gymnasium.Env[Any, Any]):
    """The game without an engine: an action is how many ticks pass."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 30}  # noqa: RUF012
    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (1,), np.float32)
    action_space = gymnasium.spaces.Discrete(3)

    def __init__(self, render_mode: str | None = None) -> None:
        self.render_mode = render_mode
        self._ticks = 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self._ticks = 0
        return np.zeros(1, np.float32), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self._ticks += int(action)
        return np.full(1, self._ticks, np.float32), 1.0, self._ticks >= STEPS, False, {}

    def render(self) -> Any:
        return draw(self._ticks)


class Blind(Ticks):
    """Shows nothing that could be filmed."""

    def render(self) -> Any:
        return "a text"


class Unpainted(Ticks):
    """Lacks a package to draw with."""

    def render(self) -> Any:
        raise gymnasium.error.DependencyNotInstalled("paint is not installed")


_register: Any = cast(Any, gymnasium).register
_register("Ticks-v0", entry_point="tests.record.games:Ticks", max_episode_steps=100)
_register("Blind-v0", entry_point="tests.record.games:Blind")
_register("Unpainted-v0", entry_point="tests.record.games:Unpainted")
