"""A Godot 3 game with a window that guides its training: keys, panel, pictures and pace."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from ludus.addon import install_addon
from ludus.engine import (
    EngineProcess,
    GodotFlags,
    InstalledEngine,
    LaunchConfig,
    ensure_imported,
    godot_command,
    read_project,
)
from ludus.engine.screen import with_display
from tests.godot3.simulation_games import CHOICE
from tests.serve.guided.test_press_play import await_that, free_port, servers

pytestmark = [pytest.mark.engine, pytest.mark.screen]
DEADLINE_S = 60.0
NUM_WORLDS, NUM_DRAWN = 8, 4
COLORS = [(255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0)]

PROJECT = """\
config_version=4
[application]
config/name="Windows"
run/main_scene="res://main.tscn"
[display]
window/size/width=640
window/size/height=360
[logging]
file_logging/enable_file_logging=false
"""
GAME = """\
[gd_scene format=2]
[ext_resource path="res://addons/ludus/ludus_simulation_host.gd" type="Script" id=1]
[ext_resource path="res://choice.gd" type="Script" id=2]
[ext_resource path="res://paint.gd" type="Script" id=3]
[node name="Game" type="Node2D"]
script = ExtResource( 1 )
simulation_script = ExtResource( 2 )
layout = {layout}
spacing = Vector3( 5000, 5000, 0 )
[node name="Paint" type="Node2D" parent="."]
script = ExtResource( 3 )
[node name="Camera" type="Camera2D" parent="."]
current = true
"""
# Each world in another colour.
PAINT = """\
extends Node2D
const COLORS := [Color.red, Color.lime, Color.blue, Color.yellow]
func _draw() -> void:
	var world: LudusWorld = LudusWorld.of(self)
	if world.is_drawn:
		draw_rect(Rect2(-2000, -2000, 4000, 4000), COLORS[world.index])
"""
MAIN = """\
[gd_scene format=2]
[ext_resource path="res://addons/ludus/ludus_training.gd" type="Script" id=1]
[ext_resource path="res://person.gd" type="Script" id=2]
[node name="Main" type="Node"]
[node name="Training" type="Node" parent="."]
script = ExtResource( 1 )
run_name = "windows"
num_worlds = {num_worlds}
num_drawn = {num_drawn}
starts_by_itself = false
scene_path = "res://game.tscn"
port = {port}
[node name="Person" type="Node" parent="."]
script = ExtResource( 2 )
"""
# Presses a key in every state, and takes a picture while it trains.
PERSON = """\
extends Node
const KEYS := [KEY_UP, 0, KEY_3, KEY_ENTER, 0]
onready var training: LudusTraining = $"../Training"
var pressed := {}
var since := 0.0
var frames := 0
var pictures := 0
func _ready() -> void:
	pause_mode = Node.PAUSE_MODE_PROCESS
func _physics_process(delta: float) -> void:
	if abs(delta * 60.0 - 1.0) > 1e-3:
		printerr("odd: a tick of ", delta)
func _process(_delta: float) -> void:
	var state := training.state
	if not pressed.has(state):
		pressed[state] = OS.get_ticks_msec()
		frames = Engine.get_idle_frames()
		pictures = Engine.get_frames_drawn()
		printerr("state: ", state)
		if KEYS[state] != 0 and state != LudusTraining.State.TRAINING:
			press(KEYS[state])
	elif state == LudusTraining.State.TRAINING:
		watch()
	elif state == LudusTraining.State.STANDBY and pressed.has(LudusTraining.State.TRAINING):
		printerr("stopped: ", training.status["updates"], " updates")
		set_process(false)
		press(KEY_O)
		var _error := training.connect("status_changed", self, "_on_status_changed")
func watch() -> void:
	var passed_ms: int = OS.get_ticks_msec() - pressed[training.state]
	if passed_ms < 3000 or pressed.has("picture"):
		return
	pressed["picture"] = true
	printerr(
		"drawn: ", Engine.get_frames_drawn() - pictures, " ", Engine.get_idle_frames() - frames)
	var image := get_viewport().get_texture().get_data()
	image.flip_y()
	var _error := image.save_png("res://picture.png")
	printerr("picture: ", ProjectSettings.globalize_path("res://picture.png"))
	press(KEY_ENTER)
func _on_status_changed(status: Dictionary) -> void:
	if status.has("written"):
		printerr("written: ", status["written"].keys())
func press(key: int) -> void:
	for is_pressed in [true, false]:
		var event := InputEventKey.new()
		event.scancode = key
		event.physical_scancode = key
		event.pressed = is_pressed
		Input.parse_input_event(event)
"""
# Tells whether the pace knows that the command line has chosen one.
FIXED = """\
extends SceneTree
func _init() -> void:
	var pace := LudusPace.new()
	print("fixed: ", pace._is_fixed)
	pace.free()
	quit()
"""


def make_project(folder: Path, layout: int, port: int) -> Path:
    folder.mkdir()
    values = {"num_worlds": NUM_WORLDS, "num_drawn": NUM_DRAWN, "port": port, "layout": layout}
    for name, text in {
        "project.godot": PROJECT,
        "game.tscn": GAME.replace("{layout}", str(layout)),
        "main.tscn": MAIN.format(**values),
        "choice.gd": CHOICE,
        "paint.gd": PAINT,
        "person.gd": PERSON,
        "fixed.gd": FIXED,
    }.items():
        (folder / name).write_text(text)
    install_addon(folder)
    return folder


def start(engine: InstalledEngine, project: Path, flags: GodotFlags) -> EngineProcess:
    ensure_imported(engine, read_project(project))
    command = with_display(godot_command(engine, project, None, flags))
    return EngineProcess.start(LaunchConfig(command=command))


def await_line(game: EngineProcess, words: str) -> str:
    deadline = time.monotonic() + DEADLINE_S
    while True:
        found = [line for line in game.last_lines(200) if words in line]
        if found:
            return found[-1]
        assert game.is_alive and time.monotonic() < deadline, game.last_lines(40)
        time.sleep(0.05)


@pytest.fixture
def port(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Port of the server that the game starts; the test leaves none behind."""
    monkeypatch.setenv("LUDUS_PYTHON", sys.executable)
    port = free_port()
    yield port
    await_that(lambda: not servers(port), lambda: "the server does not end")


@pytest.mark.parametrize("layout", [0, 1], ids=["isolated", "grid"])
def test_keys_guide_and_pictures_show_some_worlds(
    godot3: InstalledEngine, tmp_path: Path, port: int, layout: int
) -> None:
    project = make_project(tmp_path / "game", layout, port)
    game = start(godot3, project, GodotFlags(headless=False, fixed_fps=None))
    with game:
        written = await_line(game, "written: ")
        said = game.last_lines(200)
    states = [int(line.split()[-1]) for line in said if line.startswith("state: ")]
    assert states == [0, 1, 2, 3], said
    assert int(found(said, "stopped: ").split()[1]) > 0
    assert written == "written: [chooser]"
    assert (project / "policies").is_dir()
    assert not [line for line in said if "SCRIPT ERROR" in line or line.startswith("odd")]
    pictures, frames = (int(word) for word in found(said, "drawn: ").split()[1:])
    assert 0 < pictures <= frames
    check_picture(Path(found(said, "picture: ").removeprefix("picture: ")))


def found(said: list[str], words: str) -> str:
    return next(line for line in said if line.startswith(words))


def check_picture(path: Path) -> None:
    """Four views, one colour each; the panel lies over the upper right corner."""
    picture = np.asarray(Image.open(path).convert("RGB"))
    height, width, _ = picture.shape
    seen = [
        tuple(int(part) for part in picture[int(y * height), int(x * width)])
        for y in (0.4, 0.75)
        for x in (0.25, 0.45 + 0.2)
    ]
    assert seen == COLORS
    panel = picture[: height // 3, width - 200 :].reshape(-1, 3)
    assert len(np.unique(panel, axis=0)) > 20, "text over a dark background"


@pytest.mark.parametrize("fps", [None, 60])
def test_a_pace_that_is_given_is_left_alone(
    godot3: InstalledEngine, tmp_path: Path, fps: int | None
) -> None:
    project = make_project(tmp_path / "game", 0, 1)
    flags = GodotFlags(fixed_fps=fps, engine_args=("-s", "fixed.gd"))
    with start(godot3, project, flags) as game:
        assert game.wait(DEADLINE_S) == 0
        assert f"fixed: {fps is not None}" in game.last_lines(40)
