"""Whatever a game sends, it gets an answer, and only documented errors come out."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ludus.serve.godot_ai.agents import Agents
from ludus.serve.godot_ai.commands import GodotAi
from ludus.serve.godot_ai.project_files import ProjectFiles
from tests.legacy.godot_ai.conftest import INIT, REPLAYS, STATES

COMMANDS = ["init", "load", "get_action", "get_batch_actions", "submit_batch_replay", "train",
            "write_policy"]  # fmt: skip
NUMBERS = st.integers(-3, 40) | st.floats() | st.sampled_from([1e300, 10**400, -1])
JUNK = st.none() | st.booleans() | NUMBERS | st.text(max_size=5)
NAMES = st.sampled_from(["hero", "target", "", "../x", "a/b", ".", "CON", "x" * 300])
LISTS = st.lists(JUNK, max_size=7) | st.lists(st.floats(-1, 1), min_size=3, max_size=3)
FIELDS: dict[str, st.SearchStrategy[Any]] = {
    "file_name": NAMES | JUNK,
    "checkpoint_name": NAMES | JUNK,
    "path": st.sampled_from([STATES, REPLAYS, "../x", "", ".", "/", "\0"]) | JUNK,
    "steps": st.integers(-1, 3) | JUNK,
    "state": LISTS | JUNK,
    "deterministic_map": st.dictionaries(NAMES, JUNK, max_size=3) | JUNK,
    "print_logs": JUNK,
    **{key: st.integers(0, 6) | JUNK for key in INIT if key not in {"command", "file_name"}},
}
MESSAGES = st.fixed_dictionaries(
    {"command": st.sampled_from(COMMANDS) | JUNK}, optional=FIELDS
) | st.dictionaries(st.text(max_size=4), JUNK, max_size=4)
ROWS = st.fixed_dictionaries(
    {},
    optional={
        "state": LISTS, "state_": LISTS, "action": LISTS | JUNK, "reward": JUNK, "done": JUNK,
        "agent_name": NAMES | JUNK,
    },
)  # fmt: skip
REPLAY_FILES = st.fixed_dictionaries({"replays": st.lists(ROWS | JUNK, max_size=4) | JUNK}) | JUNK
STATE_FILES = st.dictionaries(NAMES, LISTS | JUNK, max_size=3) | JUNK


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fuzz")


@pytest.fixture(scope="module")
def commands(folder: Path) -> Iterator[GodotAi]:
    files = ProjectFiles(folder)
    agents = Agents(files, 0, torch.device("cpu"))
    logging.getLogger("ludus.serve").setLevel(logging.CRITICAL)
    made = GodotAi(files, agents, lambda: False)
    assert made.answer({**INIT, "batchsize": 2, "hidden_size": 4}) == {"done": True}
    yield made
    made.close()
    logging.getLogger("ludus.serve").setLevel(logging.NOTSET)


@pytest.mark.slow
@settings(
    max_examples=400, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(message=MESSAGES, states=STATE_FILES, replays=REPLAY_FILES)
def test_any_message_raises_documented_errors_only(
    commands: GodotAi, folder: Path, message: dict[str, Any], states: Any, replays: Any
) -> None:
    (folder / STATES).write_text(json.dumps(states))
    (folder / REPLAYS).write_text(json.dumps(replays))
    answer = commands.answer(message)
    assert "a defect" not in str(answer.get("error")), answer
    assert "error" in answer or answer.keys() & {"done", "action", "path"}
    json.dumps(answer, allow_nan=False)
    outside = {path.name for path in folder.parent.iterdir() if path.name.startswith("x")}
    assert outside == set()
    assert sorted(path.name for path in folder.iterdir()) == ["AIServerCommFiles"]
