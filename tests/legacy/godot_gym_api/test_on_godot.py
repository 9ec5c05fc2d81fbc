"""Our game with our classes in a real Godot 3, driven by our Python."""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

from ludus.engine import EngineKind, find_engine
from ludus.errors import (
    EngineCrashed,
    EngineStartError,
    GameError,
    ProtocolError,
)
from ludus.legacy.godot_gym_api import GodotClient
from tests.legacy.godot_gym_api.compiled import WALK
from tests.legacy.godot_gym_api.conftest import ALL, Opener, left_processes, make_project
from tests.legacy.gymgodot.conftest import ROOT, command_of

pytestmark = pytest.mark.engine

ANYWHERE = ("127.0.0.1", 0)
QUARTER = np.float32(0.25)


def started(opener: Opener, project: Path, module: Any = None, **settings: Any) -> GodotClient:
    return opener.client(module, ANYWHERE, target=project, **settings)


def test_steps_are_exact(opener: Opener, project: Path) -> None:
    """The world sees as many physics frames as an action is repeated, and time stands still."""
    client = started(opener, project)
    for repeat_action in (4, 1, 7):
        client.set_repeat_action(repeat_action)
        client.reset(ALL)
        for count in range(1, 6):
            state = client.step(0.25, ALL)
            num_frames = count * repeat_action
            assert state["agent"].frames == [num_frames, -num_frames]
            assert state["agent"].place == 0.25 * num_frames
            assert state["world"].frames == num_frames
            assert state["world"].steps == count
            assert state["world"].seconds == pytest.approx(num_frames / 60.0, abs=1e-5)


def test_nothing_moves_between_steps(opener: Opener, project: Path) -> None:
    client = started(opener, project)
    client.reset(ALL)
    first = client.step(1.0, ALL)
    assert first["world"].height > 0.0
    for count in range(1, 50):
        again = client.request({"observation": ALL})
        assert dict(again["agent"]) == dict(first["agent"])
        assert again["world"].height == first["world"].height
        # Each of the answers before had its own call of _after_send_response.
        assert again["world"].answers == first["world"].answers + count


@pytest.mark.parametrize("blocks", ["yes", "no"])
def test_frames_pass_while_nobody_asks(
    opener: Opener, project: Path, monkeypatch: pytest.MonkeyPatch, blocks: str
) -> None:
    """Not on a server, where that would only cost time, but where there is a window."""
    monkeypatch.setenv("WALK_BLOCKS", blocks)
    client = started(opener, project)
    client.reset(ALL)
    passed: list[int] = []
    before = client.step(0.25, {"world": ["idle_frames"]})["world"]
    # On a busy machine frames take longer, but there is no end of them.
    while not passed or (blocks == "no" and passed[-1] <= 15 and len(passed) < 20):
        time.sleep(0.5)
        after = client.step(0.25, {"world": ["idle_frames"]})["world"]
        passed.append(after.idle_frames - before.idle_frames)
        before = after
    assert passed[-1] > 15 if blocks == "no" else passed[-1] < 8
    for count in range(len(passed) + 2, 50):
        assert client.step(0.25, ALL)["world"].frames == 4 * count


def test_two_runs_are_equal(opener: Opener, project: Path) -> None:
    runs = [started(opener, project) for _ in range(2)]
    for client in runs:
        client.reset(ALL)
    for count in range(30):
        one, other = (client.step(count / 7.0, ALL) for client in runs)
        assert repr(one) == repr(other)
    assert runs[0].engine_address != runs[1].engine_address


def test_time_speed_leaves_a_step_as_it_is(opener: Opener, project: Path) -> None:
    client = started(opener, project)
    heights: list[float] = []
    for time_speed in (1.0, 4.0, 0.5):
        client.set_time_speed(time_speed)
        client.reset(ALL)
        world = [client.step(0.5, ALL)["world"] for _ in range(5)][-1]
        assert world.frames == 20
        assert world.seconds == pytest.approx(20 / 60.0, abs=1e-5)
        heights.append(world.height)
    assert heights == pytest.approx([heights[0]] * 3, abs=1e-5)


def test_observations_in_part(opener: Opener, project: Path) -> None:
    client = started(opener, project)
    assert client.reset({}) == {"agent": {}, "world": {}}
    assert client.step(1.0, {"agent": []})["world"] == {}
    assert client.step(1.0, {"world": []})["agent"] == {}
    agent = client.request({"observation": {"agent": ["all", "bytes"]}})["agent"]
    assert agent.picture == b"\x00\xff\x0a"
    assert agent.small == pytest.approx([1.5e-9, 0.1, -0.25], rel=1e-7)
    assert agent.where == [1, 2, 0.5]
    assert agent.name == 'Straße "1"'
    assert "picture" not in client.request({"observation": {"agent": []}})["agent"]


def test_agent_and_world_are_configured(opener: Opener, project: Path) -> None:
    client = started(opener, project)
    client.configure(agent={"scale": 2.0}, world={"start": -3.0}, environment={"repeat_action": 2})
    assert client.reset(ALL)["agent"].place == -3.0
    assert client.step(0.5, ALL)["agent"].place == -1.0
    everything = {"config": {"agent": {"scale": 1}}, "reset": 1, "action": 1, "observation": ALL}
    state = client.request(everything)
    assert (state["agent"].place, state["world"].steps) == (-1.0, 1)


def test_answers_in_protobuf(opener: Opener, protobuf_project: Path) -> None:
    client = started(opener, protobuf_project, WALK)
    state = client.reset(ALL)
    assert (state["agent"].place, state["world"].is_far) == (0.0, False)
    client.set_repeat_action(2)
    for count in range(1, 8):
        state = client.step(0.25, ALL)
        assert state["agent"].place == 0.5 * count
        assert list(state["agent"].frames) == [2 * count, -2 * count]
        assert state["world"].is_far == (count == 7)
    assert not client.step(0.0, {"agent": []})["world"].is_far
    client.set_repeat_action(1000)
    assert list(client.step(0.0, ALL)["agent"].frames) == [1016, -1016]


def test_protobuf_without_a_module(opener: Opener, protobuf_project: Path) -> None:
    client = started(opener, protobuf_project)
    with pytest.raises(ProtocolError) as caught:
        client.reset(ALL)
    assert "protobuf_message_module" in caught.value.hint


def test_environment_steps_in_real_godot(opener: Opener, project: Path) -> None:
    env = opener.env(
        target=project,
        engine_address=ANYWHERE,
        configuration={"environment": {"repeat_action": 2}},
    )
    for _ in range(2):
        assert env.reset(options={"world": {"start": 0.5}})[0]["place"] == 0.5
        results = [env.step(QUARTER) for _ in range(6)]
        assert [result[0]["place"] for result in results] == [1.0, 1.5, 2.0, 2.5, 3.0, 3.5]
        assert [result[1] for result in results] == [0.5, 0.75, 1.0, 1.25, 1.5, 1.75]
        assert [result[2] for result in results] == [False] * 5 + [True]


def test_shell_command_starts_the_game(opener: Opener, project: Path) -> None:
    program = find_engine(EngineKind.GODOT3).path
    command = f"cd {shlex.quote(str(project))} && exec {shlex.quote(str(program))}"
    client = opener.client(None, ANYWHERE, command=command)
    client.reset(ALL)
    assert client.step(0.25, ALL)["agent"].place == 1.0
    client.close()
    assert left_processes() == []


def test_a_game_without_an_agent_says_so(
    opener: Opener, project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("WALK_FAULT", "no_agent")
    env = opener.env(target=project, engine_address=ANYWHERE)
    with pytest.raises(EngineCrashed, match=r"(?s)sent away: RLEnvironment\.agent is not set"):
        env.reset()
    assert left_processes() == []


def test_failed_script_is_reported(
    opener: Opener, project: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Godot goes on behind the line that failed: fields are missing, and the log says why."""
    monkeypatch.setenv("WALK_FAULT", "script")
    log_path = tmp_path / "log"
    env = opener.env(target=project, engine_address=ANYWHERE, log_path=log_path)
    env.reset()
    env.step(QUARTER)
    with pytest.raises(GameError, match=r"(?s)sent a field called 'place'"):
        env.step(QUARTER)
    assert "res://agent.gd" in log_path.read_text()


def test_other_machines_are_kept_out(
    opener: Opener, project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("WALK_ADDRESS", "0.0.0.0")
    with pytest.raises(EngineStartError, match="lets other machines connect"):
        started(opener, project, start_timeout_s=6.0)


START_AND_WAIT = """
import sys
from ludus.legacy.godot_gym_api import GodotClient
client = GodotClient(None, ("127.0.0.1", 0), target=sys.argv[1])
client.reset({})
print("ready", flush=True)
sys.stdin.read()
"""


def test_game_ends_with_a_killed_trainer(project: Path) -> None:
    """Even if the trainer is killed: a game for godot_gym_api would wait for the next client."""
    with subprocess.Popen(
        [sys.executable, "-c", START_AND_WAIT, str(project)],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as trainer:
        assert trainer.stdout is not None
        assert trainer.stdout.readline() == "ready\n"
        games = psutil.Process(trainer.pid).children(recursive=True)
        assert any("godot" in " ".join(command_of(game)) for game in games)
        trainer.kill()
        trainer.wait(10.0)
    assert psutil.wait_procs(games, timeout=30.0)[1] == []


OWN_STEP = """\
func _step(action):
	agent.set_action(action)
	get_tree().set_pause(false)
	yield(physics_frames_timer.start(), "timer_end")
	get_tree().set_pause(true)
	world.num_steps += 1
"""
"""A step as the original's documentation shows it, without the base class."""
CONSTANTS = """\
	print("constants: ", JSON.print([CONFIG_KEY, RESET_KEY, ACTION_KEY, OBSERVATION_KEY,
		WORLD_KEY, AGENT_KEY, ENVIRONMENT_KEY, ProtobufMessage == null]))
"""


def changed_project(folder: Path, old: str, new: str) -> Path:
    project = make_project(folder)
    script = project / "environment.gd"
    text = script.read_text()
    assert old in text
    script.write_text(text.replace(old, new))
    return project


def test_an_environment_steps_without_the_base_class(opener: Opener, tmp_path: Path) -> None:
    text = (Path(__file__).with_name("project") / "environment.gd").read_text()
    own = text[text.index("func _step") : text.index("func _after_send_response")]
    project = changed_project(tmp_path / "own_step", own, f"{OWN_STEP}\n\n")
    client = started(opener, project)
    for repeat_action in (4, 7):
        client.set_repeat_action(repeat_action)
        client.reset(ALL)
        for count in range(1, 4):
            state = client.step(0.25, ALL)
            assert state["agent"].place == 0.25 * count * repeat_action
            assert state["world"].frames == count * repeat_action
            assert state["world"].steps == count


def test_scripts_find_the_constants_of_the_original(opener: Opener, tmp_path: Path) -> None:
    ready = "func _ready() -> void:\n"
    project = changed_project(tmp_path / "constants", ready, ready + CONSTANTS)
    log = tmp_path / "game.log"
    started(opener, project, log_path=log).reset(ALL)
    (line,) = [line for line in log.read_text().splitlines() if line.startswith("constants: ")]
    keys = ["config", "reset", "action", "observation", "world", "agent", "environment"]
    assert json.loads(line.removeprefix("constants: ")) == [*keys, True]
