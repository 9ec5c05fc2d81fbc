"""However a game or server ends, the last checkpoint is complete and the next game is served."""

from __future__ import annotations

import logging
import math
import shutil
import time
from pathlib import Path
from typing import Any

import pytest

from ludus.errors import DivergenceError, EngineStartError, GameError, LudusError, SetupError
from ludus.runs.run_folder import RunFolder
from ludus.runs.run_list import list_runs
from tests.serve.guided.conftest import Running, Start
from tests.serve.guided.game import DEADLINE_S, small_spec
from tests.serve.guided.test_guidance import await_result

pytestmark = pytest.mark.slow

HUGE = {"reward": [3e38] * 3}
"""Finite, but not its square."""


def other_spec() -> dict[str, Any]:
    spec = small_spec()
    spec["policies"][0]["action"][0]["n"] = 3
    return spec


@pytest.mark.parametrize("when", ["training", "standby", "playing"])
def test_a_game_that_reconnects_resumes_its_run(server: Running, when: str) -> None:
    game = server.training()
    if when != "training":
        game.ask("stop")
        game.await_state("standby")
    if when == "playing":
        game.delay_s = 0.2
        game.ask("play_round")
        game.await_state("playing")
    seen = game.await_updates(0)
    game.hang_up()
    again = server.game()
    back = again.await_state("standby")
    assert back["updates"] >= seen["updates"]
    assert back["agent_steps"] >= seen["agent_steps"]
    assert back["message"] == f"run goes on at {back['agent_steps']} steps"
    assert server.newest().agent_steps == back["agent_steps"]
    again.ask("start")
    again.await_updates(back["updates"] + 1)
    (run,) = list_runs(server.folder().path)
    assert run.state == "running"


def test_a_game_that_dies_within_an_answer_can_resume(server: Running) -> None:
    game = server.training()
    game.fault = b"\x00\x01"
    time.sleep(0.3)
    game.hang_up()
    again = server.game()
    assert again.await_state("standby")["updates"] > 0


@pytest.mark.parametrize(
    ("change", "code", "text"),
    [
        ({"reward": [1.0, math.nan, 1.0]}, "game", "reward"),
        (
            {"observation": {"observation": [[math.inf] * 5] * 3}},
            "game",
            'observation["observation',
        ),
        (b"\x10\x00\x00\x00\x06\x00\x00\x00" + bytes(16), "frame", "BATCH"),
        (b"GET / HTTP/1.1\r\n\r\n" * 10, "frame", "unknown type 47"),
    ],
)
def test_a_wrong_answer_is_reported_and_training_saved(
    server: Running, change: Any, code: str, text: str, caplog: pytest.LogCaptureFixture
) -> None:
    game = server.training()
    game.fault = change
    game.await_the_end()
    assert (game.last, game.report["code"]) == ("ERROR", code)
    assert text in game.report["message"]
    folder = await_result(server.folder())
    assert folder.checkpoints().newest()[1].run["updates"] >= 2
    assert server.game().await_state("standby")["updates"] >= 2
    assert any(record.levelno == logging.ERROR for record in caplog.records)


def test_a_diverged_loss_is_reported_and_recorded(server: Running) -> None:
    game = server.training(spec=small_spec(scale_reward=False))
    game.fault = HUGE
    game.await_the_end()
    assert (game.last, game.report["code"]) == ("ERROR", "internal")
    assert "diverged" in game.report["hint"]
    folder = await_result(server.folder())
    assert (folder.path / "diverged").is_dir()
    (run,) = list_runs(folder.path)
    assert run.state == "diverged"
    server.game().await_state("standby")


@pytest.mark.parametrize("other", [other_spec(), small_spec(hidden_sizes=[9])])
def test_a_run_of_other_policies_is_kept_under_another_name(
    server: Running, other: dict[str, Any]
) -> None:
    server.training().hang_up()
    for number, spec in enumerate((other, small_spec()), 1):
        game = server.game(spec=spec)
        new = game.await_state("standby")
        assert new["agent_steps"] == 0
        assert f"the previous one is kept as run.old-{number}: " in new["message"]
        game.ask("start")
        game.await_updates(2)
        game.hang_up()
        await_result(server.folder())
    names = sorted(path.name for path in server.config.runs.iterdir())
    assert names == ["run", "run.old-1", "run.old-2"]
    for name in names:
        store = RunFolder(server.config.runs / name).checkpoints()
        assert store.newest()[1].run["updates"] >= 2


def test_a_run_of_another_algorithm_is_kept_under_another_name(server: Running) -> None:
    server.training().hang_up()
    spec = small_spec()
    spec["policies"][0]["action"] = [
        {"name": "push", "kind": "continuous", "size": 1, "low": -1, "high": 1}
    ]
    spec["policies"][0]["settings"] = {"algorithm": "sac", "hidden_sizes": [8]}
    game = server.game(spec=spec)
    assert "kept as run.old-1" in game.await_state("standby")["message"]


def test_the_newest_loadable_checkpoint_is_resumed(server: Running) -> None:
    server.training().hang_up()
    folder = await_result(server.folder())
    before, newest = folder.checkpoints().paths()[-2:]
    tensors = newest / "tensors.safetensors"
    tensors.write_bytes(tensors.read_bytes()[:-7])
    game = server.game()
    back = game.await_state("standby")
    assert back["agent_steps"] == int(before.name.removeprefix("step-"))


@pytest.mark.parametrize("left", ["update-000000000004", "unloadable-step-000000000008", "none"])
def test_opening_and_closing_a_run_removes_nothing_of_it(server: Running, left: str) -> None:
    server.training().hang_up()
    folder = await_result(server.folder())
    store = folder.checkpoints()
    if left != "none":
        store.paths()[-1].rename(store.folder / left)
    for path in store.paths():
        shutil.rmtree(path)
    game = server.game()
    game.await_state("standby")
    game.hang_up()
    server.end()
    assert left == "none" or (store.folder / left / "tensors.safetensors").is_file()
    assert folder.metrics.is_file()


def test_a_new_run_that_holds_something_is_kept(server: Running) -> None:
    game = server.game()
    game.await_state("standby")
    (server.folder().path / "notes.txt").write_text("mine")
    game.hang_up()
    server.end()
    assert (server.folder().path / "notes.txt").read_text() == "mine"


def test_an_empty_folder_that_was_there_before_is_kept(server: Running) -> None:
    server.folder().path.mkdir(parents=True)
    game = server.game()
    game.await_state("standby")
    game.hang_up()
    server.end()
    assert server.folder().path.is_dir()


def test_a_run_without_a_loadable_checkpoint_is_kept_under_another_name(server: Running) -> None:
    server.training().hang_up()
    for path in await_result(server.folder()).checkpoints().paths():
        (path / "state.json").write_text("{")
    new = server.game().await_state("standby")
    assert new["agent_steps"] == 0
    assert "can be loaded" in new["message"]
    assert (server.config.runs / "run.old-1/checkpoints").is_dir()


def test_a_run_that_another_process_trains_is_refused(server: Running, tmp_path: Path) -> None:
    server.training().hang_up()
    with await_result(server.folder()).locked():
        game = server.game()
        game.await_the_end()
        assert game.report["code"] == "internal"
        assert "is being trained by another process" in game.report["message"]
    server.game().await_state("standby")


def test_a_folder_that_is_not_a_run_is_left_unchanged(server: Running) -> None:
    (server.config.runs / "run").mkdir()
    (server.config.runs / "run/thesis.txt").write_text("two years of work")
    game = server.game()
    game.await_the_end()
    assert "is not a run" in game.report["message"]
    assert (server.config.runs / "run/thesis.txt").read_text() == "two years of work"
    server.game("other").await_state("standby")


def test_an_unknown_setting_is_reported(server: Running) -> None:
    game = server.game(spec=small_spec(learning_rat=1))
    game.await_the_end()
    assert game.report["code"] == "config"
    assert "unknown setting learning_rat" in game.report["message"]
    assert not server.folder().path.exists()


def test_a_wrong_spec_is_reported(server: Running) -> None:
    game = server.game(spec={**small_spec(), "num_worlds": 0})
    game.await_the_end()
    assert game.report["code"] == "frame"
    assert "spec.num_worlds" in game.report["message"]


def test_a_failing_disk_is_reported_and_the_next_game_served(server: Running) -> None:
    """The disk fails while a game trains: it is told, and the next one is served."""
    game = server.training()
    shutil.rmtree(server.folder().path)
    server.folder().path.touch()
    game.ask("stop")
    game.await_the_end()
    assert game.report["code"] == "internal"
    assert "cannot write" in game.report["message"]
    server.game("other").await_state("standby")


@pytest.mark.parametrize("is_training", [True, False])
def test_stopping_the_server_saves_and_closes(server: Running, is_training: bool) -> None:
    game = server.game()
    if is_training:
        game.ask("start")
        game.await_updates(2)
    server.stop()
    game.await_the_end()
    assert game.last == "CLOSE"
    if is_training:
        assert server.newest().run["updates"] >= 2
        (run,) = list_runs(server.folder().path)
        assert run.state == "interrupted"
    else:
        assert not server.folder().path.exists()


# --- once ---------------------------------------------------------------------------------------


def test_once_ends_when_the_game_disconnects(start: Start) -> None:
    server = start(is_once=True)
    server.training().hang_up()
    server.wait()
    assert server.error is None
    assert server.newest().run["updates"] >= 2


def test_once_keeps_waiting_after_a_rejected_client(start: Start) -> None:
    server = start(is_once=True)
    game = server.game(hello={"protocol": {"min": 9, "max": 9}}, run=None)
    game.await_the_end()
    assert game.report["code"] == "version"
    server.training().hang_up()
    server.wait()
    assert server.error is None


def test_once_fails_if_no_game_connects(start: Start) -> None:
    began = time.monotonic()
    server = start(is_once=True, first_game_timeout_s=0.5)
    server.wait()
    assert time.monotonic() - began < DEADLINE_S
    error, server.error = server.error, None
    assert isinstance(error, EngineStartError)
    assert error.message == "no game connected within 0.5 s"


@pytest.mark.parametrize("kind", [GameError, DivergenceError])
def test_once_raises_the_error_of_the_game(start: Start, kind: type[LudusError]) -> None:
    server = start(is_once=True)
    game = server.training(spec=small_spec(scale_reward=False))
    game.fault = {"reward": [math.nan] * 3} if kind is GameError else HUGE
    server.wait()
    error, server.error = server.error, None
    assert type(error) is kind


def test_a_second_server_on_the_port_is_an_error(server: Running, start: Start) -> None:
    second = start(port=server.port)
    second.wait()
    error, second.error = second.error, None
    assert isinstance(error, SetupError)
    assert f"cannot listen at 127.0.0.1:{server.port}" in error.message
