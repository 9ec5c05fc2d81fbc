"""A game in real Godot that guides its training, told what to ask for by files."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ludus.addon import install_addon
from ludus.engine import (
    EngineProcess,
    GodotFlags,
    LaunchConfig,
    ensure_imported,
    find_engine,
    godot_command,
    read_project,
)

__all__ = ["EPISODE_STEPS", "NUM_WORLDS", "SCENE", "GodotGame", "make_project"]

DEADLINE_S = 90.0
NUM_WORLDS, EPISODE_STEPS = 6, 10

PROJECT = """\
config_version=5
[application]
config/name="Guides"
config/features=PackedStringArray("4.4")
run/main_scene="res://main.tscn"
"""

# Say what the other says, or don't; ten steps long.
PENNIES = """\
extends LudusAgent
static var is_broken := false
@export var sign := 1.0
@export var other: LudusAgent
var choice := 0
var steps := 0
func _init() -> void:
	observation = [LudusObservationEntry.create("seen", [SIZE])]
	action = [LudusActionComponent.discrete("say", 2)]
	settings = LudusPolicySettings.new()
	settings.hidden_sizes = [8]
	settings.more = {"rollout_steps": 20, "epochs": 1}
	ticks_per_step = 1
func apply_action(given: int) -> void:
	choice = given
func get_observation() -> Array:
	var seen := []
	seen.resize(SIZE)
	seen.fill(steps / 10.0)
	return seen
func get_reward() -> float:
	steps += 1
	if is_broken and LudusWorld.of(self).index == 2:
		return NAN
	return sign if choice == other.choice else -sign
func is_done() -> bool:
	return steps >= 10
func reset() -> void:
	steps = 0
"""

SCENE = """\
[gd_scene format=3]
[ext_resource type="Script" path="res://pennies.gd" id="1"]
[node name="Game" type="Node"]
[node name="Even" type="Node" parent="." node_paths=PackedStringArray("other")]
script = ExtResource("1")
policy_name = "even"
other = NodePath("../Odd")
[node name="Odd" type="Node" parent="." node_paths=PackedStringArray("other")]
script = ExtResource("1")
policy_name = "odd"
sign = -1.0
other = NodePath("../Even")
"""

# Does what files ask for, and notes what it is told.
DRIVER = """\
extends Node
const KEYS := {
	&"ludus_train_first": [KEY_7, KEY_KP_7],
	&"ludus_train_second": [KEY_8, KEY_KP_8],
	&"ludus_train_all": [KEY_9, KEY_KP_9],
	&"ludus_train_none": [KEY_0, KEY_KP_0],
}
@onready var training: LudusTraining = $"../Training"
var folder := ""
var heard: FileAccess
func _init() -> void:  # before the node above looks whether the project has these actions
	for action: StringName in KEYS:
		InputMap.add_action(action)
		for key: Key in KEYS[action]:
			var event := InputEventKey.new()
			event.keycode = key
			InputMap.action_add_event(action, event)
func press(key: Key) -> void:
	for is_down: bool in [true, false]:
		var event := InputEventKey.new()
		event.keycode = key
		event.pressed = is_down
		Input.parse_input_event(event)
func _ready() -> void:
	process_mode = Node.PROCESS_MODE_ALWAYS
	for argument: String in OS.get_cmdline_user_args():
		if argument.begins_with("--folder="):
			folder = argument.trim_prefix("--folder=")
		elif argument.begins_with("--port="):
			training.port = int(argument.trim_prefix("--port="))
	heard = FileAccess.open(folder.path_join("heard"), FileAccess.WRITE)
	training.status_changed.connect(note)
	training.state_changed.connect(_on_state_changed)
	training.connect_trainer()
func _on_state_changed(state: LudusTraining.State) -> void:
	if state == LudusTraining.State.OFFLINE:
		note({"state": "offline", "message": training.message})
func note(status: Dictionary) -> void:
	heard.store_line(JSON.stringify(status))
	heard.flush()
func _process(_delta: float) -> void:
	var path := folder.path_join("ask")
	if not FileAccess.file_exists(path):
		return
	var words := FileAccess.get_file_as_string(path).split(" ")
	DirAccess.remove_absolute(path)
	match words[0]:
		"break":
			load("res://pennies.gd").is_broken = true
		"set_policy_mode":
			training.set_policy_mode(words[1], LudusBridge.PolicyMode.get(words[2]))
		"press":
			press(OS.find_keycode_from_string(words[1].replace("_", " ")))
		_:
			training.call(words[0])
"""

MAIN = """\
[gd_scene format=3]
[ext_resource type="Script" path="res://addons/ludus/training/ludus_training.gd" id="1"]
[ext_resource type="Script" path="res://driver.gd" id="2"]
[node name="Main" type="Node"]
[node name="Training" type="Node" parent="."]
script = ExtResource("1")
run_name = "pennies"
num_worlds = {num_worlds}
checkpoint_every_updates = 4
autostart = false
scene_path = "res://pennies.tscn"
[node name="Driver" type="Node" parent="."]
script = ExtResource("2")
"""


def make_project(folder: Path, observation_size: int = 2) -> Path:
    """Write the project into a folder; returns it."""
    folder.mkdir(exist_ok=True)
    pennies = PENNIES.replace("SIZE", str(observation_size))
    (folder / "project.godot").write_text(PROJECT)
    (folder / "pennies.gd").write_text(pennies)
    (folder / "pennies.tscn").write_text(SCENE)
    (folder / "driver.gd").write_text(DRIVER)
    (folder / "main.tscn").write_text(MAIN.format(num_worlds=NUM_WORLDS))
    install_addon(folder)
    return folder


class GodotGame:
    """A game that runs; end it with :meth:`close`.

    Attributes:
        process: Of Godot.
    """

    def __init__(self, project: Path, folder: Path, port: int) -> None:
        found = read_project(project)
        engine = find_engine(found.engine_kind)
        ensure_imported(engine, found)
        folder.mkdir()
        self._folder = folder
        self._num_seen = 0
        user_args = (f"--folder={folder}", f"--port={port}")
        command = godot_command(engine, project, "res://main.tscn", GodotFlags(user_args=user_args))
        self.process = EngineProcess.start(LaunchConfig(command=command))

    def ask(self, what: str) -> None:
        """Let the game call a method of its ``LudusTraining``, once the last call was made."""
        path = self._folder / "ask"
        self._wait_for(lambda: not path.exists(), f"{what} is not taken")
        written = path.with_suffix(".new")
        written.write_text(what)
        written.rename(path)

    def await_status(self, what: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """Wait for a status behind those that were seen so far; returns it."""
        found: dict[str, Any] = {}

        def has_come() -> bool:
            for status in self._heard()[self._num_seen :]:
                self._num_seen += 1
                if what(status):
                    found.update(status)
                    return True
            return False

        self._wait_for(has_come, "that status never came")
        return found

    def await_state(self, state: str) -> dict[str, Any]:
        return self.await_status(lambda status: status["state"] == state)

    def await_updates(self, num: int) -> dict[str, Any]:
        return self.await_status(lambda status: status.get("updates", -1) >= num)

    def train(self) -> dict[str, Any]:
        """Begin to train, and return a status of a few updates later."""
        first = self.await_state("standby")
        self.ask("start")
        return self.await_updates(first["updates"] + 5)

    def close(self) -> None:
        self.process.terminate()

    def _heard(self) -> list[dict[str, Any]]:
        path = self._folder / "heard"
        text = path.read_text() if path.exists() else ""
        return [json.loads(line) for line in text.splitlines(keepends=True) if line[-1] == "\n"]

    def _wait_for(self, is_there: Callable[[], bool], what: str) -> None:
        deadline = time.monotonic() + DEADLINE_S
        while not is_there():
            is_alive = self.process.is_alive
            assert is_alive and time.monotonic() < deadline, (
                what,
                self._heard()[-2:],
                self.process.last_lines(20),
            )
            time.sleep(0.02)
