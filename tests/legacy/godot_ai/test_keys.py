"""Press Play: the game's keys guide training, as with godot-ai; real Godot and a real server."""

from __future__ import annotations

import socket
import sys
import time
from pathlib import Path

import psutil
import pytest

from ludus.engine import (
    EngineKind,
    EngineProcess,
    LaunchConfig,
    ensure_imported,
    find_engine,
    read_project,
)
from ludus.model import read_model
from tests.legacy.godot_ai.projects import Events, legacy_addon_game

pytestmark = [pytest.mark.engine, pytest.mark.timeout(600)]

TIMEOUT_S = 400.0

# A person at the keyboard: a key, and what is waited for before the next one.
PERSON = """\
extends Node
const State = LudusTraining.State
var _keys = [
	[0, func(): return runner()._initial_simulations.size() == 8 and is_begun()],
	[KEY_UP, func(): return training().state == State.STANDBY and has_left_worlds()],
	[KEY_3, func(): return runner()._is_loop_training and runner()._loop_train_count > 4],
	[KEY_8, func(): return is_learning(false, true)],
	[KEY_7, func(): return is_learning(true, false)],
	[KEY_KP_8, func(): return is_learning(false, true)],
	[KEY_KP_7, func(): return is_learning(true, false)],
	[KEY_9, func(): return is_learning(true, true)],
	[KEY_0, func(): return is_learning(false, false)],
	[KEY_KP_9, func(): return is_learning(true, true)],
	[KEY_KP_0, func(): return is_learning(false, false)],
	[KEY_2, func(): return training().state == State.PLAYING],
	[0, func(): return runner()._is_loop_training],
	[KEY_O, func(): return FileAccess.file_exists("res://AIServerCommFiles/walker.ludus.json")],
	[KEY_ENTER, func(): return training().state == State.STANDBY],
]
func _ready():
	process_mode = Node.PROCESS_MODE_ALWAYS
	await get_tree().physics_frame
	training().port = int(OS.get_environment("POINT_PORT"))
	for step in _keys:
		if step[0] != 0:
			press(step[0])
		while not step[1].call():
			await get_tree().process_frame
		PointLog.write("did %s" % OS.get_keycode_string(step[0]))
	get_tree().quit()
func runner():
	return get_tree().current_scene._ai_runner
func training():
	return runner().training
func is_learning(walker, drifter):
	var modes = training().modes
	return (modes["walker"] == 0) == walker and (modes["drifter"] == 0) == drifter
func has_left_worlds():
	return runner()._worlds.get_child_count() == 0
func is_begun():
	return runner()._initial_simulations.all(func(sim): return sim._goals[0] != Vector2.ZERO)
func press(key):
	for is_down in [true, false]:
		var event = InputEventKey.new()
		event.keycode = key
		event.physical_keycode = key
		event.pressed = is_down
		Input.parse_input_event(event)
"""


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def await_end(pids: list[int], within_s: float) -> list[int]:
    """Return the processes that have not ended in time."""
    deadline = time.monotonic() + within_s
    while any(map(psutil.pid_exists, pids)) and time.monotonic() < deadline:
        time.sleep(0.1)
    return [pid for pid in pids if psutil.pid_exists(pid)]


def servers(port: int) -> list[int]:
    """Return the servers that games have started at a port."""
    return [
        process.pid
        for process in psutil.process_iter(["cmdline"])
        if {"serve", str(port)} <= set(process.info["cmdline"] or ())
    ]


@pytest.mark.slow
def test_the_keys_of_godot_ai(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    project = legacy_addon_game(tmp_path / "game")
    (project / "person.gd").write_text(PERSON)
    with (project / "project.godot").open("a") as file:
        file.write('\n[autoload]\n\nPerson="*res://person.gd"\n')
    port, log = free_port(), tmp_path / "log.txt"
    monkeypatch.setenv("POINT_PORT", str(port))
    monkeypatch.setenv("POINT_LOG", str(log))
    monkeypatch.setenv("LUDUS_PYTHON", sys.executable)
    engine = find_engine(EngineKind.GODOT4)
    ensure_imported(engine, read_project(project))
    command = (str(engine.executable(headless=True)), "--headless", "--path", str(project))
    output = tmp_path / "engine.log"
    with EngineProcess.start(LaunchConfig(command=command, log_path=output)) as game:
        code = game.wait(TIMEOUT_S)
        started = servers(port)
        assert code == 0, game.describe_death()
        assert game.script_errors == []
    assert await_end(started, 30.0) == [], "the server ends with the game"
    events = Events(log)
    done = [" ".join(row) for row in events.of("did")]
    who_learns = ["8", "7", "Kp 8", "Kp 7", "9", "0", "Kp 9", "Kp 0"]
    assert done == ["", "Up", "3", *who_learns, "2", "", "O", "Enter"]
    assert events.counts("clean") == events.counts("new"), "by both worlds and trainer"
    told = [" ".join(row[1:]) for row in events.of("status") if len(row) > 1]
    start = told.index("playing")
    assert told[:start][-1].startswith("standby: new run PointEnv")
    epoch = ["playing", "submitting", "training", "Done Training"]
    assert told[start : start + 4] == epoch
    assert any(words.startswith("playing: ") for words in told), "key 2"
    assert told[-1].startswith("standby: saved checkpoint at")
    policy = read_model(project / "AIServerCommFiles" / "walker.ludus.json")
    assert policy.spec.name == "walker"
    runs = [entry for entry in (project / "runs").iterdir() if entry.is_dir()]
    assert [run.name for run in runs] == ["PointEnv"]
    assert list((runs[0] / "checkpoints").iterdir())
