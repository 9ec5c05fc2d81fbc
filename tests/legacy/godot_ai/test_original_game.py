"""The same game, unchanged, over godot-ai's wire; what the server wrote, played by our add-on."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ludus.engine import (
    EngineKind,
    EngineProcess,
    LaunchConfig,
    ensure_imported,
    find_engine,
    read_project,
)
from ludus.model import ModelRunner, read_model
from ludus.serve.godot_ai.serving import ServeConfig
from tests.legacy.godot_ai.conftest import Running
from tests.legacy.godot_ai.projects import Events, legacy_addon_game, original_game

pytestmark = [pytest.mark.engine, pytest.mark.games, pytest.mark.timeout(600)]

ROUNDS = 26
TIMEOUT_S = 400.0
FOLDER = "AIServerCommFiles"

# Plays the policies of both kinds of file, and writes down what they put out.
PLAYER = """\
extends SceneTree
func _initialize():
	var states = [[0.5, -0.25, -0.5, 1.0], [0.0, 0.0, 0.0, 0.0], [-1.0, 1.0, 1.0, -1.0]]
	var loader = PolicyLoader.new()
	loader.try_to_load_policy_data("walker")
	var network = NeuralNetwork.new(loader._policy_weights, loader._policy_biases)
	var agent = PolicyAgent.new(network)
	var told = {"states": states, "outputs": [], "actions": [], "drawn": []}
	for state in states:
		var input: Array[float] = []
		input.assign(state)
		told["outputs"].append(network.feed_forward(input))
		told["actions"].append(agent.get_action(input, true))
		told["drawn"].append(agent.get_action(input))
	var none = PolicyLoader.new()
	none.try_to_load_policy_data("nobody")
	told["loaded"] = [loader._did_load_policy_data, none._did_load_policy_data]
	var file = FileAccess.open("res://played.json", FileAccess.WRITE)
	file.store_string(JSON.stringify(told))
	file.close()
	quit()
"""


def run_godot(project: Path, *arguments: str) -> None:
    """Run Godot on a project until it ends by itself, without an error."""
    engine = find_engine(EngineKind.GODOT4)
    ensure_imported(engine, read_project(project))
    program = str(engine.executable(headless=True))
    command = (program, "--headless", "--path", str(project), *arguments)
    with EngineProcess.start(LaunchConfig(command=command)) as game:
        code = game.wait(TIMEOUT_S)
        assert code == 0, game.describe_death()
        assert game.script_errors == []


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, Events]]:
    """The original project after some rounds with our server, and what the game wrote down."""
    folder = tmp_path_factory.mktemp("wire")
    project = original_game(folder / "game")
    config = ServeConfig(project=project, port=0, seed=7)
    server = Running(config)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("POINT_LOG", str(folder / "log.txt"))
        try:
            run_godot(project, "--fixed-fps", "60", "--", str(server.port), str(ROUNDS))
        finally:
            server.stop()
    yield project, Events(folder / "log.txt")


def test_the_unchanged_game_learns_over_the_wire(played: tuple[Path, Events]) -> None:
    project, events = played
    scores: list[float] = json.loads((project / FOLDER / "scores.json").read_text())["scores"]
    assert len(scores) == ROUNDS
    # A net that has learnt nothing goes nowhere, or by chance far from its goal: the game draws
    # where that is, without a seed.
    begin, end = np.mean(scores[:3]), np.mean(scores[-5:])
    assert end > 0.6, f"what it gets once it goes to its goal: {scores}"
    assert end > begin + 0.2, scores
    assert len(events.counts("new")) == 8 * ROUNDS
    assert events.counts("clean") == events.counts("new")
    assert {act[2] for act in events.of("act")} == {"0"}, "nobody acts who is done"


@pytest.mark.parametrize("kind", ["walker_policy.json", "walker.ludus.json"])
def test_what_the_server_wrote_is_played(
    kind: str, played: tuple[Path, Events], tmp_path: Path
) -> None:
    source = played[0] / FOLDER
    project = legacy_addon_game(tmp_path / "game")
    (project / FOLDER).mkdir()
    shutil.copy(source / kind, project / FOLDER)
    (project / "player.gd").write_text(PLAYER)
    run_godot(project, "-s", "res://player.gd")
    told: dict[str, Any] = json.loads((project / "played.json").read_text())
    assert told["loaded"] == [True, False]
    runner = ModelRunner(read_model(source / "walker.ludus.json"))
    observation = {"state": np.array(told["states"], np.float32)}
    outputs, _ = runner.outputs(observation)
    np.testing.assert_allclose(told["outputs"], outputs, atol=1e-4)
    np.testing.assert_allclose(told["actions"], np.tanh(outputs[:, :2]), atol=1e-4)
    drawn = np.array(told["drawn"])
    assert np.all(np.abs(drawn) <= 1.0)
    assert not np.allclose(drawn, told["actions"], atol=1e-4)
