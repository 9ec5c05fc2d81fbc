"""What is saved, what comes back, and that nothing is lost."""

from __future__ import annotations

import json
import logging
import subprocess
from pathlib import Path
from typing import Any

import pytest

from ludus.export.trained import load_trained
from tests.legacy.godot_ai.conftest import Client, Start, replays
from tests.legacy.godot_ai.test_answers import DONE, STATE, weights

FOLDER = "AIServerCommFiles/ludus"


def learn(client: Client, rounds: int = 1, seed: int = 0, **changes: Any) -> dict[str, Any]:
    """Have the agent hero learn; returns its weights."""
    for number in range(rounds):
        assert client.submit(replays(40, seed=seed + number)) == DONE
        assert client.train(10, **changes) == DONE
    return weights(client)


def steps(project: Path, name: str = "hero") -> list[str]:
    folder = project / FOLDER / name / "checkpoints"
    return sorted(path.name.removeprefix("step-").lstrip("0") for path in folder.iterdir())


def begin(start: Start, *, is_loaded: bool, **changes: Any) -> Client:
    client = start().client()
    assert client.init(**changes) == DONE
    if is_loaded:
        assert client.ask("load", file_name="hero") == DONE
    return client


def test_the_console_says_what_godot_ais_said(
    start: Start, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    first = start()
    client = first.client()
    client.init()
    client.ask("load", file_name="hero")
    assert "Agent named hero initialized. Replay Capacity: 500" in caplog.text
    assert "Checkpoint not loaded for: hero (there is none)" in caplog.text
    learn(client)
    first.stop()
    begin(start, is_loaded=True)
    assert "Checkpoint loaded for hero: 10 gradient steps" in caplog.text


def test_a_new_server_goes_on_where_the_last_one_was(start: Start, project: Path) -> None:
    first = start()
    client = first.client()
    client.init()
    before = learn(client, rounds=3)
    first.stop()
    assert steps(project) == ["20", "30"]
    again = begin(start, is_loaded=True)
    assert weights(again) == before
    assert learn(again, seed=3) != before
    assert steps(project) == ["30", "40"]


def test_optimisers_and_critics_come_back_too(start: Start, project: Path) -> None:
    """Two servers in a row learn what one learns, if the replays are submitted anew."""
    first = start()
    client = first.client()
    client.init(replay_capacity=40)  # so that a round fills the replay
    learn(client, rounds=2)
    first.stop()
    after_restart = learn(begin(start, is_loaded=True, replay_capacity=40), seed=5)
    (project / FOLDER).rename(project / "before")
    only = start()
    client = only.client()
    client.init(replay_capacity=40)
    learn(client, rounds=2)
    assert learn(client, seed=5) == after_restart


@pytest.mark.slow
def test_equal_seeds_equal_bits(start: Start, project: Path) -> None:
    def play(seed: int) -> tuple[Any, Any]:
        running = start(seed=seed)
        client = running.client()
        client.init()
        actions = client.act({"hero": STATE * 5}, {})["actions"]
        learnt = learn(client, rounds=2)
        running.stop()
        (project / FOLDER).rename(project / f"run-{len(list(project.iterdir()))}")
        return actions, learnt

    assert play(3) == play(3)
    assert play(3) != play(4)


def test_a_fresh_agent_keeps_the_checkpoints_of_the_one_before(
    start: Start, project: Path, caplog: pytest.LogCaptureFixture
) -> None:
    first = start()
    client = first.client()
    client.init()
    before = learn(client)
    first.stop()
    second = start()
    client = second.client()
    client.init()
    with caplog.at_level(logging.WARNING):
        learn(client, seed=1)
    assert "hero.old-1" in caplog.text
    second.stop()
    (project / FOLDER / "hero").rename(project / "aside")
    (project / FOLDER / "hero.old-1").rename(project / FOLDER / "hero")
    assert weights(begin(start, is_loaded=True)) == before


@pytest.mark.slow
def test_other_settings_are_refused_and_nothing_is_lost(start: Start, project: Path) -> None:
    first = start()
    client = first.client()
    client.init()
    learn(client)
    first.stop()
    for changes, message in (
        ({"state_dim": 4}, "trained for other observations or actions"),
        ({"hidden_size": 25}, "does not fit the network"),
        ({"num_critic_layers": 1}, "does not fit the network"),
    ):
        running = start()
        client = running.client()
        client.init(**changes)
        answer = client.ask("load", file_name="hero")
        assert answer["done"] is False
        assert message in answer["error"]
        assert "hero starts over" in answer["error"]
        running.stop()
    assert steps(project) == ["10"]
    assert weights(begin(start, is_loaded=True))


def test_a_corrupt_checkpoint_falls_back_to_the_one_before(start: Start, project: Path) -> None:
    first = start()
    client = first.client()
    client.init()
    before = learn(client, rounds=2)
    learn(client, seed=2)
    first.stop()
    newest = max((project / FOLDER / "hero/checkpoints").iterdir())
    (newest / "tensors.safetensors").write_bytes(b"half")
    again = begin(start, is_loaded=True)
    assert weights(again) == before
    learn(again, seed=2)  # step 30 once more
    assert steps(project) == ["20", "30", "unloadable-step-000000000030"]


def test_only_corrupt_checkpoints(start: Start, project: Path) -> None:
    first = start()
    client = first.client()
    client.init()
    learn(client)
    first.stop()
    for path in project.rglob("state.json"):
        path.write_text("{")
    again = begin(start, is_loaded=False)
    assert "can be loaded" in again.ask("load", file_name="hero")["error"]
    learn(again)
    assert steps(project, "hero.old-1") == ["10"]


def test_numbered_checkpoints(start: Start, project: Path) -> None:
    running = start()
    client = running.client()
    client.init()
    kept = learn(client, checkpoint_name="hero_1000")
    learn(client, seed=1)
    assert steps(project, "hero_1000") == ["10"]
    assert steps(project) == ["10", "20"]
    learn(client, seed=2, checkpoint_name="hero_1000")
    assert steps(project, "hero_1000") == ["30"]
    client.init(file_name="hero_1000")
    assert client.ask("load", file_name="hero_1000") == DONE
    assert weights(client, "hero_1000") == weights(client) != kept


def test_other_settings_in_the_same_session_save_what_was_there(
    start: Start, project: Path
) -> None:
    client = begin(start, is_loaded=False)
    learn(client)
    client.init(hidden_size=12)
    assert client.submit(replays(30)) == DONE
    assert client.train(5) == DONE
    assert steps(project) == ["5"]
    assert steps(project, "hero.old-1") == ["10"]


def test_an_agent_is_a_run_that_other_commands_take(start: Start, project: Path) -> None:
    client = begin(start, is_loaded=False)
    learn(client)
    (trained,) = load_trained(project / FOLDER / "hero")
    assert trained.spec.name == "hero"
    assert trained.recorded["state"].shape == (40, 3)
    config = json.loads((project / FOLDER / "hero/config.json").read_text())
    assert config["policies"]["hero"]["hidden_sizes"] == [24, 24]
    assert config["policies"]["hero"]["critic_hidden_sizes"] == [24, 24, 24]


def test_git_leaves_all_but_policies_alone(client: Client) -> None:
    learn(client)
    project = client.project
    subprocess.run(["git", "init", "-q", project], check=True)
    listed = subprocess.run(
        ["git", "ls-files", "--others", "--exclude-standard", "AIServerCommFiles"],
        cwd=project, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert listed.stdout.split() == [
        "AIServerCommFiles/hero.ludus.json", "AIServerCommFiles/hero_policy.json"
    ]  # fmt: skip


def test_a_gitignore_of_the_user_stays(start: Start, project: Path) -> None:
    mark = project / "AIServerCommFiles/.gitignore"
    mark.parent.mkdir()
    mark.write_text("mine\n")
    start()
    assert mark.read_text() == "mine\n"


def test_the_editor_leaves_checkpoints_alone(client: Client) -> None:
    assert (client.project / FOLDER / ".gdignore").is_file()
