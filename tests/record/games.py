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

from ludus.addon import install_addon

WIDTH, HEIGHT = 320, 180
NUM_BARS = 8
STEPS = 20
"""Of an episode; two ticks each."""

PROJECTS = {
    "godot4": """\
config_version=5

[application]

config/name="Ticks"
config/features=PackedStringArray("4.4")
run/main_scene="res://ticks.tscn"

[debug]

file_logging/enable_file_logging=false
file_logging/enable_file_logging.pc=false

[display]

window/size/viewport_width=320
window/size/viewport_height=180
""",
    "godot3": """\
config_version=4

[application]

config/name="Ticks"
run/main_scene="res://ticks.tscn"

[display]

window/size/width=320
window/size/height=180

[logging]

file_logging/enable_file_logging=false
""",
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
	if OS.{get_variable}("TICKS_DIE") != "" and ticks == 9:
		OS.{kill}(OS.get_{pid}())
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
DIALECTS = {
    "godot4": {
        "server": "RenderingServer",
        "position": "position",
        "size": "size",
        "get_variable": "get_environment",
        "kill": "kill",
        "pid": "process_id",
    },
    "godot3": {
        "server": "VisualServer",
        "position": "rect_position",
        "size": "rect_size",
        "get_variable": "get_environment",
        "kill": "kill",
        "pid": "process_id",
    },
}

SCENES = {
    "godot4": """\
[gd_scene format=3]
[ext_resource path="res://ticks.gd" type="Script" id="1"]
[ext_resource path="res://addons/ludus/agent/ludus_agent.gd" type="Script" id="2"]
[ext_resource path="res://addons/ludus/agent/ludus_action_component.gd" type="Script" id="3"]
[sub_resource type="Resource" id="1"]
script = ExtResource("3")
[node name="Ticks" type="Node2D"]
script = ExtResource("1")
[node name="LudusAgent" type="Node" parent="."]
script = ExtResource("2")
action = Array[ExtResource("3")]([SubResource("1")])
""",
    "godot3": """\
[gd_scene format=2]
[ext_resource path="res://ticks.gd" type="Script" id=1]
[ext_resource path="res://addons/ludus/ludus_agent.gd" type="Script" id=2]
[ext_resource path="res://addons/ludus/ludus_action_component.gd" type="Script" id=3]
[sub_resource type="Resource" id=1]
script = ExtResource( 3 )
[node name="Ticks" type="Node2D"]
script = ExtResource( 1 )
[node name="LudusAgent" type="Node" parent="."]
script = ExtResource( 2 )
action = [ SubResource( 1 ) ]
""",
}


def ticks_project(folder: Path, kind: str) -> Path:
    """Make the project for one kind of engine."""
    folder.mkdir()
    (folder / "project.godot").write_text(PROJECTS[kind])
    install_addon(folder)
    (folder / "ticks.gd").write_text(SCRIPT.format(**DIALECTS[kind]))
    (folder / "ticks.tscn").write_text(SCENES[kind])
    return folder


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


_register: Any = cast(Any, gymnasium).register
_register("Ticks-v0", entry_point="tests.record.games:Ticks", max_episode_steps=100)
_register("Blind-v0", entry_point="tests.record.games:Blind")
