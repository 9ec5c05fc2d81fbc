"""Requests of a game are carried out, and the game is informed."""

from __future__ import annotations

import logging
import time
from typing import Any

import pytest
import torch

from ludus.model import read_model
from ludus.networks.tensors import as_tensor
from ludus.runs.checkpoint import Checkpoint
from ludus.runs.control import SetMode, send_request
from ludus.runs.run_folder import RunFolder
from tests.serve.guided.conftest import Running, Start
from tests.serve.guided.game import CAPABILITIES, EPISODE_STEPS, small_spec

pytestmark = pytest.mark.slow


def weights(checkpoint: Checkpoint) -> dict[str, torch.Tensor]:
    return checkpoint.learners["cart"].tensors


def assert_equal(first: Checkpoint, second: Checkpoint) -> None:
    assert first.agent_steps == second.agent_steps
    one, two = weights(first), weights(second)
    assert one.keys() == two.keys()
    assert [name for name in one if not torch.equal(one[name], two[name])] == []


def test_without_requests_the_game_stands_by_and_leaves_no_run(server: Running) -> None:
    game = server.game()
    first = game.await_state("standby")
    assert first["agent_steps"] == first["updates"] == 0
    assert first["policies"] == {"cart": {"mode": "train", "mean_return": None}}
    assert first["run"] == str(server.folder().path)
    assert first["message"] == "new run run"
    assert "guided" in game.welcome["capabilities"]
    assert game.welcome["config"]["num_worlds"] == 3
    game.await_state("standby")
    assert game.events == ["standby", "stand_by", "standby"]
    game.hang_up()
    server.end()
    assert not server.folder().path.exists(), "nothing was trained"


def test_training_starts_stops_and_resumes_on_request(server: Running) -> None:
    game = server.game()
    game.ask("start")
    game.await_updates(3)
    assert server.folder().checkpoints().paths()
    game.ask("stop")
    stopped = game.await_state("standby")
    assert stopped["message"] == f"saved checkpoint at {stopped['agent_steps']} steps"
    assert stopped["policies"]["cart"]["mean_return"] == EPISODE_STEPS
    assert server.newest().agent_steps == stopped["agent_steps"]
    assert server.newest().run["updates"] == stopped["updates"]
    later = game.await_state("standby")
    assert later["agent_steps"] == stopped["agent_steps"]
    game.ask("start")
    again = game.await_state("training")
    assert again["agent_steps"] == stopped["agent_steps"]
    goes_on = game.await_updates(stopped["updates"] + 2)
    assert goes_on["agent_steps"] > stopped["agent_steps"]
    # The game hears of each state before it is in it.
    changes = [event for event in game.events if event != "STEP"]
    assert changes[changes.index("training") + 1] == "RESET"
    assert "RESET" not in changes[: changes.index("training")]
    assert game.events[game.events.index("stand_by", 3) - 1] == "standby"


def test_stop_takes_effect_within_a_rollout(server: Running) -> None:
    game = server.game(spec=small_spec(rollout_steps=4096))
    game.delay_s = 0.005
    game.ask("start")
    game.await_status(lambda status: status["agent_steps"] > 0)
    game.ask("stop")
    stopped = game.await_state("standby")
    assert stopped["updates"] == 0
    assert 0 < server.newest().agent_steps < 3 * 4096


def test_a_save_does_not_discard_the_rollout(server: Running) -> None:
    game = server.game(spec=small_spec(rollout_steps=200))
    game.delay_s = 0.005
    game.ask("start")
    game.await_status(lambda status: status["agent_steps"] > 0)
    game.ask("save")
    game.await_message("saved checkpoint")
    game.await_updates(1)
    game.ask("stop")
    game.await_state("standby")
    # Each update took 200 steps of three agents; nothing was collected twice.
    metrics = server.folder().metrics.read_text().splitlines()
    assert '"agent_steps": 600,' in metrics[0].replace(":", ": ").replace(":  ", ": ")


def test_a_round_is_reported_and_changes_no_weights(server: Running) -> None:
    game = server.training()
    game.ask("stop")
    game.await_state("standby")
    before = server.newest()
    game.ask("play_round")
    game.await_state("playing")
    played = game.await_state("standby")
    assert played["round"] == {"cart": {"mean_return": float(EPISODE_STEPS), "episodes": 3}}
    assert "round" not in game.await_state("standby")
    game.ask("save")
    game.await_message("saved checkpoint")
    assert_equal(before, server.newest())
    game.ask("start")
    game.await_updates(played["updates"] + 1)


def test_a_round_interrupts_training_which_then_resumes(server: Running) -> None:
    game = server.training()
    game.ask("play_round")
    game.await_state("playing")
    after = game.await_state("training")
    assert after["round"]["cart"]["episodes"] == 3
    game.await_updates(after["updates"] + 1)


def test_a_stopped_round_is_not_reported(server: Running) -> None:
    game = server.game()
    game.delay_s = 0.2
    game.ask("play_round")
    game.await_state("playing")
    game.ask("stop")
    assert "round" not in game.await_state("standby")


def test_start_during_a_round_comes_after_it(server: Running) -> None:
    game = server.game()
    game.delay_s = 0.02
    game.ask("play_round", "start")
    game.await_state("playing")
    assert "round" in game.await_state("training")


def test_modes_and_what_is_written(server: Running) -> None:
    game = server.training()
    game.ask("set_mode", policy="cart", mode="deterministic")
    game.await_status(lambda status: status["policies"]["cart"]["mode"] == "deterministic")
    game.ask("stop")
    game.await_state("standby")
    frozen = server.newest()
    game.ask("write_policies")
    written = game.await_status(lambda status: "written" in status)["written"]
    assert "written" not in game.await_state("standby")
    assert written == {"cart": str(server.folder().path / "policies/cart.ludus.json")}
    model = read_model(written["cart"])
    actor = weights(frozen)["policy.actor.0.weight"]
    assert torch.equal(as_tensor(model.layers[0].weight), actor)
    game.ask("start")
    game.await_status(lambda status: status["agent_steps"] > frozen.agent_steps)
    game.ask("stop")
    game.await_state("standby")
    names = [name for name in weights(frozen) if name.startswith("policy.")]
    assert all(torch.equal(weights(frozen)[name], weights(server.newest())[name]) for name in names)


def test_a_mode_set_before_training_is_kept(server: Running) -> None:
    game = server.game()
    game.ask("set_mode", policy="cart", mode="frozen")
    game.await_status(lambda status: status["policies"]["cart"]["mode"] == "frozen")
    game.ask("start")
    training = game.await_status(lambda status: status["agent_steps"] > 0)
    assert training["policies"]["cart"]["mode"] == "frozen"


def test_policies_are_written_to_the_folder_of_the_command(start: Start, tmp_path: Any) -> None:
    server = start(policies=tmp_path / "game" / "policies")
    game = server.game()
    game.ask("write_policies")
    written = game.await_status(lambda status: "written" in status)
    assert written["written"] == {"cart": str(tmp_path / "game/policies/cart.ludus.json")}
    assert written["message"] == f"wrote policies to {tmp_path / 'game/policies'}"


def test_a_folder_that_cannot_be_written_is_reported(start: Start, tmp_path: Any) -> None:
    (tmp_path / "file").touch()
    game = start(policies=tmp_path / "file").game()
    game.ask("write_policies")
    assert "cannot write" in game.await_message("file")["message"]
    game.ask("start")
    game.await_updates(1)


@pytest.mark.parametrize(
    ("request_", "text"),
    [
        ({"kind": "stop"}, "there is nothing to stop"),
        ({"kind": "dance"}, 'unknown request: {"kind": "dance"}'),
        ({"kind": "set_mode", "policy": "villain", "mode": "train"}, "villain"),
    ],
)
def test_a_request_that_cannot_be_carried_out_is_reported(
    server: Running, request_: dict[str, str], text: str, caplog: pytest.LogCaptureFixture
) -> None:
    game = server.game()
    game.await_state("standby")
    with caplog.at_level(logging.WARNING):
        game.ask(request_["kind"], **{k: v for k, v in request_.items() if k != "kind"})
        assert game.await_message(text)["state"] == "standby"
    assert text in caplog.text
    game.ask("start")
    game.await_updates(1)
    game.ask("start")
    assert game.await_message("training is running already")["state"] == "training"


def test_checkpoints_at_the_chosen_updates_are_kept(server: Running) -> None:
    training = {"run": "run", "num_worlds": 3, "checkpoint_every_updates": 2}
    game = server.game(training=training)
    game.ask("start")
    game.await_updates(7)
    game.ask("stop")
    stopped = game.await_state("standby")
    names = sorted(path.name for path in server.folder().checkpoints().folder.glob("update-*"))
    assert names == [f"update-{k:012d}" for k in range(2, stopped["updates"] + 1, 2)]


def test_requests_of_the_command_line_are_carried_out(server: Running) -> None:
    game = server.training()
    send_request(server.folder().control, SetMode("cart", "frozen"))
    game.await_status(lambda status: status["policies"]["cart"]["mode"] == "frozen")
    game.ask("stop")
    game.await_state("standby")
    send_request(server.folder().control, SetMode("cart", "train"))
    game.await_status(lambda status: status["policies"]["cart"]["mode"] == "train")


def test_a_game_that_does_not_guide_is_trained_at_once(server: Running) -> None:
    game = server.game(run=None)
    game.await_updates(2)
    assert game.events[:2] == ["training", "RESET"]
    assert game.welcome["config"]["num_worlds"] == 1
    game.ask("stop")
    game.await_the_end()
    assert (game.last, "stand_by" in game.events) == ("CLOSE", False)
    folder = await_result(server.folder("cartpole"))
    assert folder.checkpoints().newest()[1].agent_steps > 0


def test_an_old_add_on_is_trained_at_once(server: Running) -> None:
    old = {"capabilities": [name for name in CAPABILITIES if name not in {"guided", "requests"}]}
    game = server.game(hello=old)
    deadline = time.monotonic() + 20
    while game.num_steps <= 200:
        assert time.monotonic() < deadline, game.num_steps
        time.sleep(0.05)
    assert game.statuses == []
    game.hang_up()
    await_result(server.folder())


def await_result(folder: RunFolder) -> RunFolder:
    """Wait until the server has left the run; returns its folder."""
    deadline = time.monotonic() + 20
    while not folder.result.exists() or folder.is_running():
        assert time.monotonic() < deadline, list(folder.path.rglob("*"))
        time.sleep(0.05)
    return folder
