"""Real games, of Godot 4 and 3, that tell their trainer what to do, and hear how training goes.

PROTOCOL.md §8.
"""

from __future__ import annotations

import os
import re
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from ludus.addon import install_addon
from ludus.engine import (
    EngineKind,
    EngineProcess,
    GodotFlags,
    LaunchConfig,
    ensure_imported,
    find_engine,
    godot_command,
    read_project,
)
from ludus.errors import GameError
from ludus.pool import PoolConfig, open_pool
from ludus.session import EngineSession, LaunchOptions, open_session
from ludus.wire import handshake
from ludus.wire.handshake import EngineConfig
from ludus.wire.requests import MODES
from tests.actions import zeros
from tests.godot.conftest import reset, step
from tests.targets import find_game
from tests.wire.golden import load

pytestmark = pytest.mark.engine

# Asks in step `ask_at` of the parameters, and when it is called; keeps what it hears.
ASKER = """\
extends LudusAgent
var steps := 0
var heard := []
func _init() -> void:
	action = [LudusActionComponent.discrete("move", 2)]
	observation = [LudusObservationEntry.create("steps", [1])]
func _ready() -> void:
	Ludus.training_status.connect(func(status: Dictionary) -> void: heard.append(status))
	Ludus.policy_mode_changed.connect(_on_policy_mode_changed)
func _on_policy_mode_changed(policy: String, mode: LudusBridge.PolicyMode) -> void:
	heard.append([policy, mode])
func ludus_ask(what: String, policy: String = "") -> bool:
	match what:
		"save":
			return Ludus.save_checkpoint()
		"stop":
			return get_node("/root/Ludus").stop_training()
		_:
			return Ludus.set_policy_mode(policy, LudusBridge.PolicyMode.get(what))
func ludus_get_heard() -> Array:
	return heard
func apply_action(_action: int) -> void:
	steps += 1
	if steps == world.parameters.get("ask_at", -1):
		assert(ludus_ask("FROZEN", "hero"))
		assert(ludus_ask("save"))
func get_observation() -> Array:
	return [steps]
func get_reward() -> float:
	return 0.0
func is_done() -> bool:
	return false
func reset() -> void:
	steps = 0
"""

ASKER3 = """\
extends LudusAgent
var steps := 0
var heard := []
func _init() -> void:
	action = [LudusActionComponent.discrete("move", 2)]
	observation = [LudusObservationEntry.create("steps", PoolIntArray([1]))]
func _ready() -> void:
	assert(Ludus.connect("training_status", self, "_on_training_status") == OK)
	assert(Ludus.connect("policy_mode_changed", self, "_on_policy_mode_changed") == OK)
func _on_training_status(status: Dictionary) -> void:
	heard.append(status)
func _on_policy_mode_changed(policy: String, mode: int) -> void:
	heard.append([policy, mode])
func ludus_ask(what: String, policy: String = "") -> bool:
	match what:
		"save":
			return Ludus.save_checkpoint()
		"stop":
			return get_node("/root/Ludus").stop_training()
		_:
			return Ludus.set_policy_mode(policy, LudusBridge.PolicyMode[what])
func ludus_get_heard() -> Array:
	return heard
func apply_action(_action: int) -> void:
	steps += 1
	if steps == LudusWorld.of(self).parameters.get("ask_at", -1):
		assert(ludus_ask("FROZEN", "hero"))
		assert(ludus_ask("save"))
func get_observation() -> Array:
	return [steps]
func get_reward() -> float:
	return 0.0
func is_done() -> bool:
	return false
func reset() -> void:
	steps = 0
"""

# Asks as soon as it is there, before the trainer knows the spec.
READY = "func _ready() -> void:\n"
READY_AND_EAGER = READY + '\tprint("ready, asked: ", ludus_ask("DETERMINISTIC", "target"))\n'

HEAD = """\
[gd_scene load_steps=2 format=3]
[ext_resource type="Script" path="res://{script}.gd" id="1"]
[ext_resource type="Script" path="res://shown.gd" id="2"]
[node name="Game" type="Node"]
[node name="Shown" type="Label" parent="."]
script = ExtResource("2")
"""
HEAD3 = """\
[gd_scene format=2]
[ext_resource path="res://{script}.gd" type="Script" id=1]
[node name="Game" type="Node"]
"""
AGENT = """\
[node name="{name}" type="Node" parent="."]
script = ExtResource({script})
policy_name = "{policy}"
ticks_per_step = 1
"""
# A node that the trainer may call, to reach what the page shows.
READER = """\
extends LudusAgent
func ludus_press(action_name: StringName) -> void:
	var event := InputEventAction.new()
	event.action = action_name
	event.pressed = true
	get_node("../Shown")._unhandled_key_input(event)
func ludus_get_text() -> String:
	return get_node("../Shown").text
"""

HERO = {"world": 0, "agent": "Hero"}
BRIDGE = {"bridge": True}
STATUS: dict[str, Any] = {
    "agent_steps": 4096,
    "updates": 3,
    "policies": {
        "hero": {"mode": "frozen", "mean_return": -1.5},
        "target": {"mode": "train", "mean_return": None},
    },
}

Open = Callable[..., EngineSession]


def page_example() -> str:
    page = (Path(__file__).parents[2] / "docs/godot.md").read_text()
    section = page[page.index("## From the game") :]
    found = re.search(r"```gdscript\n(.*?)```", section, re.DOTALL)
    assert found is not None
    return found[1]


@pytest.fixture(scope="module", params=list(EngineKind))
def kind(request: pytest.FixtureRequest) -> EngineKind:
    """Which Godot it is."""
    return request.param


@pytest.fixture(scope="module")
def project(kind: EngineKind, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("requests")
    if kind is EngineKind.GODOT4:
        write_project(folder, 5, HEAD, '"1"', {"asker": ASKER, "reader": ASKER + reader_methods()})
        (folder / "shown.gd").write_text(page_example())
    else:
        write_project(folder, 4, HEAD3, "1", {"asker": ASKER3})
    install_addon(folder)
    return folder


def write_project(
    folder: Path, version: int, head: str, script_id: str, scripts: dict[str, str]
) -> None:
    """Write a project with a scene for each script, and one for an eager asker."""
    (folder / "project.godot").write_text(
        f'config_version={version}\n[application]\nconfig/name="Asks"\n'
        'run/main_scene="res://eager.tscn"\n'
    )
    scripts["eager"] = scripts["asker"].replace(READY, READY_AND_EAGER)
    agents = "".join(
        AGENT.format(name=policy.title(), policy=policy, script=script_id)
        for policy in ("hero", "target")
    )
    for name, text in scripts.items():
        (folder / f"{name}.gd").write_text(text)
        (folder / f"{name}.tscn").write_text(head.format(script=name) + agents)


def reader_methods() -> str:
    return READER.removeprefix("extends LudusAgent\n")


@pytest.fixture
def open_game(project: Path) -> Iterator[Open]:
    sessions: list[EngineSession] = []

    def open_it(scene: str = "asker", num_worlds: int = 1, log: Path | None = None) -> Any:
        target = find_game(project, scene=f"res://{scene}.tscn")
        config, options = EngineConfig(num_worlds=num_worlds), LaunchOptions(log_path=log)
        sessions.append(open_session(target, config, options))
        return sessions[-1]

    yield open_it
    for session in sessions:
        session.close()


def test_requests_come_with_the_step_in_which_they_are_made(open_game: Open) -> None:
    session = open_game()
    reset(session, ask_at=3)
    for number in range(1, 6):
        batch = step(session)["hero"]
        assert batch.observation["steps"].tolist() == [[number]]
        assert session.has_requests == (number == 3)
        # Both agents ask for the same, which counts once.
        expected = [{"kind": "set_mode", "policy": "hero", "mode": "frozen"}, {"kind": "save"}]
        assert session.take_requests() == (expected if number == 3 else [])


def test_requests_wait_until_they_are_taken(open_game: Open) -> None:
    session = open_game()
    reset(session, ask_at=1)
    for _ in range(3):
        step(session)
        assert session.has_requests
    reset(session)
    assert session.has_requests
    assert len(session.take_requests()) == 2
    step(session)
    assert not session.has_requests


def test_every_request(open_game: Open) -> None:
    session = open_game()
    reset(session)
    for mode in MODES:
        assert session.call(HERO, "ludus_ask", [mode.upper(), "target"]) is True
    assert session.call(HERO, "ludus_ask", ["save"]) is True
    assert session.call(HERO, "ludus_ask", ["stop"]) is True
    assert not session.has_requests, "no answer to a step has told of it yet"
    step(session)
    assert session.take_requests() == [
        *({"kind": "set_mode", "policy": "target", "mode": mode} for mode in MODES),
        {"kind": "save"},
        {"kind": "stop"},
    ]


def test_many_worlds_ask_for_the_same(open_game: Open) -> None:
    session = open_game(num_worlds=40)
    reset(session, ask_at=1)
    step(session)
    assert [request["kind"] for request in session.take_requests()] == ["set_mode", "save"]


def test_a_policy_that_is_none(open_game: Open, tmp_path: Path) -> None:
    log = tmp_path / "engine.log"
    session = open_game(log=log)
    reset(session)
    assert session.call(HERO, "ludus_ask", ["FROZEN", "villain"]) is False
    step(session)
    assert not session.has_requests
    session.close()
    assert 'there is no policy "villain"; the game has: hero, target' in log.read_text()


def test_a_game_may_ask_before_its_spec_is_known(open_game: Open) -> None:
    session = open_game("eager")
    reset(session)
    asked = {"kind": "set_mode", "policy": "target", "mode": "deterministic"}
    assert session.take_requests() == [asked]


def test_the_game_hears_how_training_goes(open_game: Open) -> None:
    session = open_game()
    reset(session)
    session.show_status(STATUS)
    later = {
        **STATUS,
        "policies": {**STATUS["policies"], "hero": {"mode": "train", "mean_return": 8}},
    }
    session.show_status(later)
    train, frozen = MODES.index("train"), MODES.index("frozen")
    heard = session.call(HERO, "ludus_get_heard")
    assert heard == [["hero", frozen], ["target", train], STATUS, ["hero", train], later]
    step(session, 3)
    assert session.call(HERO, "ludus_get_heard") == heard


def test_the_golden_status_is_heard(open_game: Open) -> None:
    session = open_game()
    reset(session)
    status = load("call_show_status").content["arguments"][0]
    session.show_status(status)
    assert session.call(HERO, "ludus_get_heard")[-1] == status


REFUSED: list[tuple[str, list[Any], str]] = [
    ("queue_free", [], "the add-on has no method queue_free"),
    ("save_checkpoint", [], "the add-on has no method save_checkpoint"),
    ("show_status", [], "show_status takes one object"),
    ("show_status", ["all is well"], "show_status takes one object"),
    ("show_status", [{}, {}], "show_status takes one object"),
]


@pytest.mark.parametrize(("method", "arguments", "what"), REFUSED)
def test_a_call_that_the_add_on_refuses(
    open_game: Open, method: str, arguments: list[Any], what: str
) -> None:
    session = open_game()
    reset(session)
    with pytest.raises(GameError, match=what):
        session.call(BRIDGE, method, arguments)
    step(session)
    assert session.call(BRIDGE, "take_requests") == []


def test_a_trainer_that_takes_no_requests(
    open_game: Open, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    old = handshake.CAPABILITIES - {"requests"}
    monkeypatch.setattr(handshake, "CAPABILITIES", old)
    log = tmp_path / "engine.log"
    session = open_game("eager", log=log)
    reset(session)
    for what in ("save", "stop", "FROZEN"):
        assert session.call(HERO, "ludus_ask", [what, "hero"]) is False
    step(session)
    assert not session.has_requests
    session.close()
    text = log.read_text()
    assert "ready, asked: false" in text.lower()
    assert text.count("is ignored: the trainer is too old") == 1


def await_line(words: str, process: EngineProcess) -> None:
    """Wait until a game has printed something."""
    deadline = time.monotonic() + 30.0
    while not any(words in line for line in process.last_lines()):
        assert time.monotonic() < deadline and process.is_alive, process.last_lines()
        time.sleep(0.05)


def test_without_a_trainer(project: Path, kind: EngineKind) -> None:
    engine = find_engine(kind)
    ensure_imported(engine, read_project(project))
    command = godot_command(engine, project, "res://eager.tscn", GodotFlags())
    with EngineProcess.start(LaunchConfig(command=command)) as process:
        await_line("is ignored: no trainer is connected", process)
        assert process.wait(1.0) is None, process.last_lines()
        lines = process.last_lines()
    assert sum(line.lower() == "ready, asked: false" for line in lines) == 2
    assert sum("is ignored: no trainer is connected" in line for line in lines) == 1
    assert not process.script_errors


def test_many_engines(project: Path) -> None:
    with open_pool(project / "asker.tscn", PoolConfig(num_engines=2)) as pool:
        pool.reset(1, [None, {"ask_at": 2}])
        taken: list[list[dict[str, Any]]] = []
        for _ in range(3):
            pool.step(zeros(pool))
            taken.append(pool.take_requests())
            pool.show_status(STATUS)
        assert [len(requests) for requests in taken] == [0, 2, 0]
        # Two signals with the first status, then one with each.
        assert [len(heard) for heard in pool.call(HERO, "ludus_get_heard")] == [5, 5]


def test_an_engine_that_is_killed_between_two_steps(project: Path) -> None:
    with open_pool(project / "asker.tscn", PoolConfig(num_engines=2, max_restarts=1)) as pool:
        pool.reset(1, {"ask_at": 2})
        pool.step(zeros(pool))
        session = pool.sessions[1]
        assert isinstance(session, EngineSession) and session.pid is not None
        os.kill(session.pid, signal.SIGKILL)
        pool.show_status(STATUS)
        assert pool.num_restarts == 1
        assert pool.take_requests() == []
        batch = pool.step(zeros(pool))["hero"]
        assert batch.truncated.tolist() == [False, True]
        assert len(pool.take_requests()) == 2, "engine 0 has asked in its second step"
        pool.step(zeros(pool))
        pool.step(zeros(pool))
        assert len(pool.take_requests()) == 2, "engine 1 has asked in its own second step"
        pool.show_status(STATUS)
        assert [len(heard) for heard in pool.call(HERO, "ludus_get_heard")] == [4, 3]


@pytest.mark.parametrize("kind", [EngineKind.GODOT4], indirect=True)  # what the page is about
def test_the_example_of_the_page(open_game: Open) -> None:
    session = open_game("reader")
    reset(session)
    session.show_status(STATUS)
    assert session.call(HERO, "ludus_get_text") == "4096 steps, hero (frozen): -1.5"
    session.call(HERO, "ludus_press", ["ui_accept"])
    session.call(HERO, "ludus_press", ["ui_cancel"])
    step(session)
    frozen = {"kind": "set_mode", "policy": "hero", "mode": "frozen"}
    assert session.take_requests() == [frozen, {"kind": "stop"}]


@pytest.mark.parametrize("kind", [EngineKind.GODOT4], indirect=True)
def test_other_methods_of_a_node_are_out_of_reach(open_game: Open) -> None:
    session = open_game()
    for method in ("queue_free", "set_script", "apply_action"):
        with pytest.raises(GameError, match=f"does not let trainers call {method}"):
            session.call(HERO, method, [])
