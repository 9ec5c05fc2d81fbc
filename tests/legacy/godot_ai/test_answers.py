"""Conversations as games for godot-ai have them, right ones and wrong ones."""

from __future__ import annotations

import json
import math
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ludus.model.inference import ModelRunner
from ludus.model.json_file import read_model
from ludus.serve.godot_ai import agents as agents_module
from tests.legacy.godot_ai.conftest import INIT, REPLAYS, STATES, Client, Start, replays

DONE = {"done": True}
STATE = [0.5, -0.25, 1.0]


def weights(client: Client, name: str = "hero") -> dict[str, Any]:
    """Return the parameters of the actor, as the game gets them."""
    assert client.ask("write_policy", file_name=name) == DONE
    folder = client.project / "AIServerCommFiles"
    return json.loads((folder / f"{name}_policy.json").read_text())


def forward(parameters: dict[str, Any], state: list[float]) -> list[float]:
    """Return what the mean action is, computed from the file alone."""
    x = np.array(state)
    numbers = sorted({int(name.split(".")[2]) for name in parameters})
    for number in numbers:
        weight = np.array(parameters[f"network.network.{number}.weight"])
        x = weight @ x + parameters[f"network.network.{number}.bias"]
        x = np.maximum(x, 0.0) if number != numbers[-1] else x
    return np.tanh(x[: len(x) // 2]).tolist()


def test_a_whole_conversation(client: Client) -> None:
    assert client.init(file_name="target", state_dim=2, action_dim=1) == DONE
    for name in ("hero", "target"):
        assert client.ask("load", file_name=name) == DONE  # nothing was saved; no error
    states = {"hero": STATE * 3, "target": [0.0, 1.0]}
    answer = client.act(states, {"hero": True, "target": False})
    assert answer["path"] == "AIServerCommFiles/batch_action.json"
    assert set(answer) == {"path", "actions"}
    assert {name: len(part) for name, part in answer["actions"].items()} == {"hero": 6, "target": 1}
    assert answer["actions"]["hero"][:2] == answer["actions"]["hero"][4:]

    before = weights(client)
    assert client.submit(replays(64)) == DONE
    assert client.train(40) == DONE
    after = weights(client)
    assert before.keys() == after.keys()
    assert all(before[name] != after[name] for name in before)

    (action,) = [client.ask("get_action", file_name="hero", state=STATE)["action"]]
    batch = client.act({"hero": STATE}, {"hero": True})["actions"]["hero"]
    assert action == pytest.approx(batch, abs=1e-6)
    assert action == pytest.approx(forward(after, STATE), abs=1e-5)


def test_layers_are_those_of_godot_ai(client: Client) -> None:
    shapes = {name: np.shape(value) for name, value in weights(client).items()}
    assert shapes == {
        "network.network.0.weight": (24, 3), "network.network.0.bias": (24,),
        "network.network.2.weight": (24, 24), "network.network.2.bias": (24,),
        "network.network.4.weight": (4, 24), "network.network.4.bias": (4,),
    }  # fmt: skip


def test_the_policy_file_of_ludus_computes_the_same(client: Client) -> None:
    client.submit(replays(64))
    client.train(20)
    client.ask("write_policy", file_name="hero")
    model = read_model(client.project / "AIServerCommFiles/hero.ludus.json")
    runner = ModelRunner(model)
    actions, _ = runner.act({"state": np.array([STATE], np.float32)})
    expected = client.ask("get_action", file_name="hero", state=STATE)["action"]
    assert actions.continuous[0].tolist() == pytest.approx(expected, abs=1e-5)


def test_actions_are_drawn_unless_deterministic(client: Client) -> None:
    fixed = [client.act({"hero": STATE}, {"hero": True})["actions"] for _ in range(2)]
    assert fixed[0] == fixed[1]
    drawn = client.act({"hero": STATE * 500}, {})["actions"]["hero"]
    assert len(set(drawn)) > 900
    assert all(-1.0 <= value <= 1.0 for value in drawn)
    assert np.std(drawn) > 0.3


@pytest.mark.slow
def test_it_learns_what_brings_reward(client: Client) -> None:
    for seed in range(4):
        client.submit(replays(120, seed=seed, done=1))
        client.train(300)
    states = np.random.default_rng(9).uniform(-1, 1, (50, 3))
    actions = client.act({"hero": states.ravel().tolist()}, {"hero": True})["actions"]["hero"]
    mistake = np.abs(states[:, :2] - np.reshape(actions, (50, 2))).mean()
    assert mistake < 0.25, "doing nothing has 0.5"


def test_games_start_again_while_the_server_goes_on(start: Start) -> None:
    running = start()
    client = running.client()
    client.init()
    client.submit(replays(64))
    client.train(10)
    before = weights(client)
    client.close()
    again = running.client()
    assert again.init() == DONE
    assert again.ask("load", file_name="hero") == DONE
    assert weights(again) == before
    assert again.train(5) == DONE  # what was submitted is still there


def test_an_agent_with_nothing_to_learn_from(client: Client) -> None:
    before = weights(client)
    assert client.train(10) == DONE
    assert weights(client) == before


def test_no_agents_at_a_moment(client: Client) -> None:
    assert client.act({"hero": []}, {"hero": True})["actions"] == {"hero": []}
    assert client.submit([]) == DONE


def test_whole_floats_count_as_integers(client: Client) -> None:
    floats = {key: float(value) for key, value in INIT.items() if isinstance(value, int)}
    assert client.init(**floats) == DONE


# --- what games get wrong -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"state_dim": 0}, "state_dim: expected 1 to 1000000, got 0"),
        ({"action_dim": -1}, "action_dim: expected 1 to"),
        ({"hidden_size": 2.5}, "hidden_size: expected an integer, got 2.5"),
        ({"batchsize": "500"}, "batchsize: expected an integer, got '500'"),
        ({"batchsize": True}, "batchsize: expected an integer, got True"),
        ({"replay_capacity": None}, "replay_capacity: expected an integer, got None"),
        ({"num_actor_layers": 10**400}, "num_actor_layers: expected"),
        ({"file_name": "../hero"}, "file_name: expected a name"),
        ({"file_name": ".hero"}, "file_name: expected a name"),
        ({"file_name": ""}, "file_name: expected a name"),
        ({"file_name": 3}, "file_name: expected a text"),
        ({"replay_capacity": 10**9, "state_dim": 10**4}, "GB"),
        ({"hidden_size": 16_000, "num_critic_layers": 60}, "parameters"),
    ],
)
def test_wrong_init_changes_nothing(client: Client, changes: dict[str, Any], message: str) -> None:
    answer = client.init(**{"file_name": "other", **changes})
    assert answer["done"] is False
    assert message in answer["error"]
    assert "error" in client.ask("load", file_name="other")
    assert client.train(1) == DONE  # hero has not noticed


def test_missing_field_is_named(client: Client) -> None:
    answer = client.ask("init", file_name="other")
    assert answer["error"].startswith("init.state_dim: missing")


@pytest.mark.parametrize("command", ["fly", "", None, 3, ["init"], {}])
def test_unknown_command_lists_the_known(client: Client, command: Any) -> None:
    client.send(json.dumps({"command": command}).encode())
    assert "there is no command" in client.receive()["error"]
    client.send(b"{}")
    assert "known: init, load, get_action" in client.receive()["error"]
    assert client.train(1) == DONE


@pytest.mark.parametrize(
    ("command", "values", "key"),
    [
        ("load", {}, "done"),
        ("train", {"steps": 1, "print_logs": False, "checkpoint_name": "x"}, "done"),
        ("write_policy", {}, "done"),
        ("get_action", {"state": STATE}, "action"),
    ],
)
def test_unknown_agent_lists_the_known(client: Client, command: str, values: Any, key: str) -> None:
    answer = client.ask(command, file_name="nobody", **values)
    assert "there is no agent 'nobody'; agents: hero" in answer["error"]
    assert key in answer, "an unmodified game reads it"


@pytest.mark.parametrize(
    ("states", "message"),
    [
        ([1.0, 2.0], "hero has 2 numbers, expected 3 for each agent"),
        ([1.0, 2.0, 3.0, 4.0], "hero has 4 numbers, expected 3 for each agent"),
        ([1.0, None, 3.0], "hero[1] is NaN"),
        ([1.0, 2.0, 1e60], "hero[2] is infinite"),
        ([1.0, 2.0, "3"], "hero[2] must be a number, not '3'"),
        ([1.0, True, 3.0], "hero[1] must be a number, not True"),
        ([[1.0, 2.0, 3.0]], "hero[0] must be a number"),
        ([1, 2, 10**400], "hero has a number without bounds"),
        ("123", "hero must be a list of numbers"),
    ],
)
def test_wrong_states_get_zero_actions(client: Client, states: Any, message: str) -> None:
    client.init(file_name="target")
    answer = client.act({"hero": states, "target": STATE}, {})
    assert message in answer["error"]
    actions = answer["actions"]
    assert set(actions["hero"]) <= {0.0}  # an unmodified game stands still
    assert len(actions["target"]) == 2  # the others act
    assert math.prod(actions["target"]) != 0.0
    assert "error" not in client.act({"hero": STATE}, {})


@pytest.mark.parametrize("state", [[1.0], STATE * 2, [1.0, None, 2.0], [], None, {}])
def test_wrong_state_gets_a_zero_action(client: Client, state: Any) -> None:
    answer = client.ask("get_action", file_name="hero", state=state)
    assert "state" in answer["error"]
    assert answer["action"] == [0.0, 0.0]


def test_states_of_an_unknown_agent(client: Client) -> None:
    answer = client.act({"nobody": STATE, "hero": STATE}, {})
    assert "there is no agent 'nobody'" in answer["error"]
    assert [len(part) for part in answer["actions"].values()] == [0, 2]


@pytest.mark.parametrize("table", [3, {"hero": "yes"}])
def test_wrong_deterministic_map_is_named(client: Client, table: Any) -> None:
    assert "deterministic_map" in client.act({"hero": STATE}, table)["error"]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"state": [1.0, 2.0]}, "replays[3].state has 2 numbers, expected 3"),
        ({"state_": [1.0] * 4}, "replays[3].state_ has 4 numbers, expected 3"),
        ({"action": [1.0]}, "replays[3].action has 1 numbers, expected 2"),
        ({"action": [1.0, None]}, "replays[3].action[1] is NaN"),
        ({"reward": None}, "replays[3].reward[0] is NaN"),
        ({"reward": 1e39}, "replays[3].reward[0] is infinite"),
        ({"reward": "1"}, "replays[3].reward[0] must be a number"),
        ({"done": 2}, "replays[3].done: expected 0 or 1, got 2"),
        ({"agent_name": "nobody"}, "replays[3]: there is no agent 'nobody'"),
        ({"agent_name": 3}, "replays[3].agent_name: expected a text, got 3"),
    ],
)
def test_wrong_replays_are_left_out_and_the_others_kept(
    client: Client, changes: dict[str, Any], message: str
) -> None:
    rows = replays(6)
    rows[3] |= changes
    answer = client.submit(rows)
    assert answer["done"] is False
    assert answer["error"].startswith(f"1 of 6 replays were left out: {message}")
    assert client.train(4) == DONE  # the other five are there
    client.ask("load", file_name="hero")
    state = json.loads(next(client.project.rglob("state.json")).read_text())
    assert state["agent_steps"] == 5


@pytest.mark.parametrize("rows", [3, None, {}])
def test_replays_must_be_a_list(client: Client, rows: Any) -> None:
    assert "replays: expected a list" in client.submit(rows)["error"]


def test_a_replay_that_is_no_object_or_lacks_a_part(client: Client) -> None:
    row = replays(1)[0]
    del row["state_"]
    answer = client.submit([5, row])
    assert answer["error"].startswith(
        "2 of 2 replays were left out: replays[0]: expected an object"
    )
    assert "replays[0].state_: missing" in client.submit([row])["error"]


@pytest.mark.parametrize("steps", [-1, 1e300, None, "1", 0.5])
def test_steps_must_be_a_count(client: Client, steps: Any) -> None:
    assert "train.steps: expected" in client.train(steps)["error"]


def test_checkpoint_name_must_be_a_name(client: Client) -> None:
    client.submit(replays(20))
    assert "checkpoint_name" in client.train(1, checkpoint_name="../x")["error"]
    assert client.train(1, checkpoint_name="") == DONE
    assert client.ask("train", file_name="hero", steps=1) == DONE


# --- files ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "path", ["../secret.json", "/etc/passwd", "AIServerCommFiles/../../secret.json", "a\0b", "link"]
)
@pytest.mark.parametrize("command", ["get_batch_actions", "submit_batch_replay"])
def test_paths_stay_inside_the_project(client: Client, command: str, path: str) -> None:
    secret = client.project.parent / "secret.json"
    secret.write_text(json.dumps({"hero": STATE, "replays": []}))
    (client.project / "link").symlink_to(secret)
    answer = client.ask(command, path=path, deterministic_map={})
    assert "path" in answer["error"] or "leads out of the project" in answer["error"]
    assert str(secret) not in answer["error"]


def test_a_bulk_folder_that_leads_outside_is_not_written_to(client: Client, tmp_path: Path) -> None:
    outside = tmp_path / "outside"
    shutil.move(client.project / "AIServerCommFiles", outside)
    (client.project / "AIServerCommFiles").symlink_to(outside)
    (client.project / "states.json").write_text(json.dumps({"hero": STATE}))
    answer = client.ask("get_batch_actions", path="states.json", deterministic_map={})
    assert "leads out of the project" in answer["error"]
    assert "leads out of the project" in client.ask("write_policy", file_name="hero")["error"]
    assert sorted(path.name for path in outside.iterdir()) == [".gitignore", "ludus"]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is not JSON"),
        (b"[]", "expected an object"),
        (b'{"hero": [1, 2,', "is not JSON"),
        (b"\xff\xfe", "is not JSON"),
        (b"[" * 100_000, "is not JSON"),
    ],
)
def test_broken_files_give_no_actions(client: Client, content: bytes, message: str) -> None:
    client.act({"hero": STATE}, {})
    (client.project / STATES).write_bytes(content)
    answer = client.ask("get_batch_actions", path=STATES, deterministic_map={})
    assert message in answer["error"]
    actions = json.loads((client.project / answer["path"]).read_text())
    assert actions == {"hero": []}, "actions of another step must not be taken for these"


def test_missing_files_are_named(client: Client) -> None:
    assert "there is no file" in client.ask("submit_batch_replay", path=REPLAYS)["error"]
    answer = client.ask("submit_batch_replay", path="AIServerCommFiles")
    assert "there is no file" in answer["error"]
    assert "path: missing" in client.ask("submit_batch_replay")["error"]


def test_paths_of_the_resource_system(client: Client) -> None:
    client.submit(replays(3))
    assert client.ask("submit_batch_replay", path=f"res://{REPLAYS}") == DONE
    assert client.ask("submit_batch_replay", path=str(client.project / REPLAYS)) == DONE


def test_no_half_files_are_left(client: Client) -> None:
    client.act({"hero": STATE}, {})
    client.ask("write_policy", file_name="hero")
    names = sorted(path.name for path in (client.project / "AIServerCommFiles").iterdir())
    assert names == [
        ".gitignore", "batch_action.json", "batch_state.json", "hero.ludus.json",
        "hero_policy.json", "ludus",
    ]  # fmt: skip


# --- what must never happen -----------------------------------------------------------------------


def test_divergence_goes_back_to_the_last_checkpoint(client: Client) -> None:
    client.submit(replays(64))
    client.train(10)
    before = weights(client)
    client.submit(replays(500, reward=3e38))
    answer = client.train(20)
    assert answer["done"] is False
    assert "goes on from its last checkpoint" in answer["error"]
    assert weights(client) == before
    client.submit(replays(64))
    assert client.train(10) == DONE


def test_a_defect_does_not_leave_the_game_waiting(
    client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise ZeroDivisionError("on purpose")

    monkeypatch.setattr(agents_module.Agents, "save", fail)
    client.submit(replays(20))
    answer = client.train(1)
    assert answer["done"] is False
    assert "a defect of ludus serve: ZeroDivisionError: on purpose" in answer["error"]
    assert "action" in client.ask("get_action", file_name="hero", state=STATE)
