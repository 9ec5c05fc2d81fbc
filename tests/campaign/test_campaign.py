"""The campaign finds planted defects, again by their seed, and decides the same twice."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from ludus.runs import checkpoint, run_folder
from ludus.wire.frames import FrameType
from tests.campaign.__main__ import draw_fault, play
from tests.campaign.faults import FAULTS, engine_frames, frames
from tests.campaign.promises import check_checkpoints, check_nothing_left, check_nothing_ran
from tests.campaign.rounds import Finding, Round
from tests.campaign.trainer import preload
from tests.wire.stream import cut_frames

pytestmark = pytest.mark.slow
GYM = {"gym": "gym:CartPole-v1"}


@pytest.fixture(autouse=True)
def loaded() -> None:
    preload()


@pytest.fixture
def a_round(tmp_path: Path) -> Iterator[Round]:
    made = Round(1, 0, GYM, tmp_path)
    yield made
    made.close(keep=True)


def first_finding(fault: str, folder: Path, rounds: int) -> tuple[int, str]:
    """Return number and text of the first round that finds something."""
    for number in range(rounds):
        _, finding = play(1, number, [fault], GYM, folder)
        if finding:
            return number, finding
    raise AssertionError(f"{rounds} rounds of {fault} found nothing")


def test_rounds_of_kills_find_nothing_in_ludus(tmp_path: Path) -> None:
    counts, finding = play(1, 0, ["kill"], GYM, tmp_path)
    assert finding == ""
    assert counts["kills"] >= 1
    assert not list(tmp_path.iterdir())


def test_workers_that_are_harmed_cost_no_run(tmp_path: Path) -> None:
    counts, finding = play(1, 1, ["workers"], GYM, tmp_path)
    assert finding == ""
    assert counts["kills"] + counts["stops"] >= 1


def test_a_settings_file_written_in_place_is_found_and_found_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def write_in_place(path: Path, data: bytes) -> None:
        with path.open("wb") as file:
            file.write(data[: len(data) // 2])
            file.flush()
            for _ in range(30):  # a moment in which one may die
                path.with_name("metrics.jsonl").open("ab").close()
            file.write(data[len(data) // 2 :])

    monkeypatch.setattr(run_folder, "write_atomically", write_in_place)
    number, finding = first_finding("kill", tmp_path, 20)
    _, again = play(1, number, ["kill"], GYM, tmp_path)
    assert "config.json" in finding
    assert again.splitlines()[0] == finding.splitlines()[0]
    assert "config.json" in again


def test_a_checkpoint_written_in_place_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def write_in_place(path: Path, data: checkpoint.Checkpoint) -> None:
        path.mkdir(parents=True)
        for _ in range(10):  # a moment in which one may die
            (path / "state.json").touch()
        write(path.with_name("aside"), data)
        for file in path.with_name("aside").iterdir():
            file.rename(path / file.name)
        path.with_name("aside").rmdir()

    write = checkpoint.write_checkpoint
    monkeypatch.setattr(checkpoint, "write_checkpoint", write_in_place)
    assert "does not load" in first_finding("kill", tmp_path, 20)[1]


def test_a_decoder_that_raises_what_is_not_documented_is_found(a_round: Round) -> None:
    def read(data: bytes) -> None:
        for frame in cut_frames(data):
            if frame.type is FrameType.PONG and frame.payload[:1] == b"\xff":
                raise KeyError("planted")

    with pytest.raises(Finding, match=r"frame \d+ \(\w+…\) raised KeyError: 'planted'"):
        frames.fuzz_frames(a_round, read)


def test_a_changed_checkpoint_that_loads_is_found(a_round: Round) -> None:
    assert a_round.finish().wait() == 0
    state = a_round.run / "checkpoints" / a_round.saved()[-1].name / "state.json"
    a_round.damaged.add(state)
    with pytest.raises(Finding, match="loads as if it were whole"):
        check_checkpoints(a_round)


def test_a_checkpoint_that_is_gone_is_found(a_round: Round) -> None:
    a_round.saved_list.write_text(f"{a_round.run}/checkpoints/update-000000000007\n")
    with pytest.raises(Finding, match="update-000000000007 was reported as saved"):
        check_checkpoints(a_round)


def test_what_is_left_and_what_ran_is_found(a_round: Round) -> None:
    check_nothing_left(a_round)
    check_nothing_ran(a_round)
    (a_round.temporary / "ludus-left").mkdir()
    with pytest.raises(Finding, match="ludus-left"):
        check_nothing_left(a_round)
    a_round.canary_list.write_text("dill ")
    with pytest.raises(Finding, match="dill"):
        check_nothing_ran(a_round)


@pytest.mark.engine
def test_godot_reads_changed_frames(a_round: Round, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engine_frames, "FRAMES", 2000)
    engine_frames.fuzz_godot(a_round)
    assert a_round.counts["frames in Godot"] == 2000


def test_the_same_seed_makes_the_same_decisions(tmp_path: Path) -> None:
    faults = list(FAULTS)
    drawn = [[draw_fault(3, number, faults) for number in range(50)] for _ in range(2)]
    assert drawn[0] == drawn[1]
    first, second = (Round(3, 5, GYM, tmp_path) for _ in range(2))
    assert first.settings == second.settings
    assert [first.chance.random() for _ in range(9)] == [second.chance.random() for _ in range(9)]
    assert Round(3, 6, GYM, tmp_path).settings != first.settings


def test_every_kind_of_fault_is_drawn() -> None:
    faults = list(FAULTS)
    assert {draw_fault(1, number, faults) for number in range(1000)} == set(faults)
