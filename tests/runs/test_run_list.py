"""What is read from the files of runs, whole, damaged and foreign."""

from __future__ import annotations

import itertools
import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from ludus.cli.runs import listing
from ludus.errors import DivergenceError
from ludus.runs.control import StopRequest
from ludus.runs.run_folder import RunFolder
from ludus.runs.run_list import list_runs, running_runs, sample_metrics
from ludus.training.loop import train
from tests.runs.test_control import Asking


def lines(count: int, padding: int = 0) -> bytes:
    """Return ``count`` lines of metrics, each of a good 70 bytes more than ``padding``."""
    text = "".join(
        json.dumps(
            {"agent_steps": i, "policies": {"hero": {"mean_return": i / 10}}, "x": "y" * padding}
        )
        + "\n"
        for i in range(count)
    )
    return text.encode()


def steps(path: Path, count: int) -> list[int]:
    return [line["agent_steps"] for line in sample_metrics(path, count)]


def test_a_short_file_is_read_line_by_line(tmp_path: Path) -> None:
    path = tmp_path / "metrics.jsonl"
    path.write_bytes(lines(10))
    assert steps(path, 48) == list(range(10))
    assert steps(path, 5) == [0, 2, 4, 6, 8, 9]


def test_a_long_file_is_sampled_from_end_to_end(tmp_path: Path) -> None:
    path = tmp_path / "metrics.jsonl"
    path.write_bytes(lines(20_000, 100))
    found = steps(path, 40)
    assert len(found) == 41
    assert (found[0], found[-1]) == (0, 19_999)
    gaps = [second - first for first, second in itertools.pairwise(found)]
    assert all(490 < gap < 520 for gap in gaps[:-1])


def test_a_line_longer_than_the_gap_is_not_read_twice(tmp_path: Path) -> None:
    path = tmp_path / "metrics.jsonl"
    path.write_bytes(lines(10, 50_000))
    found = steps(path, 48)
    assert found == sorted(set(found))
    assert found[-1] == 9


@pytest.mark.parametrize(
    "rubbish",
    [b"", b"{", b"\xff\xfe\x00", b"[1, 2]\n", b'{"agent_steps": 1}\n', b"[" * 100_000, b"\n" * 9],
)
@pytest.mark.parametrize("count", [3, 3_000])
def test_lines_of_others_are_passed_over(rubbish: bytes, count: int, tmp_path: Path) -> None:
    path = tmp_path / "metrics.jsonl"
    path.write_bytes(rubbish + b"\n" + lines(count, 100) + rubbish)
    assert steps(path, 4)[-1] == count - 1
    path.write_bytes(rubbish)
    assert steps(path, 4) == []


def test_no_file_has_no_lines(tmp_path: Path) -> None:
    assert sample_metrics(tmp_path / "metrics.jsonl", 4) == []
    assert sample_metrics(tmp_path, 4) == []


def test_a_run_tells_how_it_ended(small: Any) -> None:
    run = train(small(evaluation_episodes=4)).path
    (summary,) = list_runs(run.parent)
    assert (summary.path, summary.target) == (run, "gym:Identity-discrete-v0")
    assert (summary.state, summary.stop_reason) == ("finished", "total_steps")
    assert (summary.agent_steps, summary.updates) == (640, 10)
    assert summary.wall_s > 0.0
    policy = summary.policies["agent"]
    evaluation = json.loads((run / "evaluation.json").read_bytes())["agent"]["mean_return"]
    assert policy.evaluation == evaluation
    assert policy.mean_return == policy.curve[-1]
    assert (len(policy.curve), policy.elo) == (10, None)
    assert list_runs(run) == [summary]


def test_a_resumed_run_forgets_how_it_ended(small: Any) -> None:
    config = small(total_steps=6_400)
    run = config.runs / "run"
    train(config, reporter=Asking(run, {2: [StopRequest()]}))
    assert list_runs(run)[0].state == "stopped"

    class Looking(Asking):
        states: list[str] = []  # noqa: RUF012

        def updated(self, progress: Any) -> None:
            self.states.append(list_runs(run)[0].state)
            super().updated(progress)

    train(config, resume=run, reporter=Looking(run, {1: [StopRequest()]}))
    assert Looking.states == ["running"]
    assert not RunFolder(run).result.with_suffix(".tmp").exists()
    assert list_runs(run)[0].updates == 3


def test_requests_to_a_run_that_had_ended_are_void(small: Any) -> None:
    from ludus.runs.control import send_request

    run = train(small()).path
    send_request(RunFolder(run).control, StopRequest())
    assert train(small(total_steps=1_280), resume=run).stop_reason == "total_steps"


def test_a_diverged_run_says_so(small: Any) -> None:
    with pytest.raises(DivergenceError):
        train(small("gym:Poisoned-v0", ppo={"scale_reward": False}))
    config = small()
    (summary,) = list_runs(config.runs)
    assert (summary.state, summary.stop_reason) == ("diverged", "diverged")


def test_what_is_no_run_is_passed_over(tmp_path: Path) -> None:
    foreign = {"a": b"{", "b": b"[]", "c": b"{}", "d": b'{"target": 3}', "e": b"\xff", "f": b""}
    for name, data in foreign.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "config.json").write_bytes(data)
    (tmp_path / "g").mkdir()
    (tmp_path / "h").write_bytes(b"")
    assert list_runs(tmp_path) == []
    assert running_runs(tmp_path) == []


@pytest.mark.parametrize(
    "result", [b"", b"{", b"[]", b'{"stop_reason": 3}', b'{"agent_steps": "many", "wall_s": null}']
)
def test_a_run_with_damaged_files_has_crashed(result: bytes, tmp_path: Path) -> None:
    (tmp_path / "config.json").write_text('{"target": "tag", "policies": {"hero": {}, "foe": 1}}')
    (tmp_path / "result.json").write_bytes(result)
    (tmp_path / "metrics.jsonl").write_bytes(lines(3) + b'{"agent_st')
    (summary,) = list_runs(tmp_path)
    assert summary.state == "crashed"
    assert summary.policies["hero"].curve == (0.0, 0.1, 0.2)
    assert summary.policies["foe"].mean_return is None


def test_the_newest_mean_of_each_metric_of_the_game_is_told(tmp_path: Path) -> None:
    (tmp_path / "config.json").write_text('{"target": "tag", "policies": {"hero": {}}}')
    games: list[object] = [
        {"coins": {"mean": 1.0}, "falls": {"mean": 0.5}},
        {"coins": {"mean": 2.0}, "lives": {"mean": None}, "time": 3},
        "none",
    ]
    written = [
        json.dumps({"agent_steps": step, "policies": {}, "game": game})
        for step, game in enumerate(games)
    ]
    (tmp_path / "metrics.jsonl").write_text("\n".join(written))
    (summary,) = list_runs(tmp_path)
    assert summary.game == {"coins": 2.0, "falls": 0.5}
    means = {f"metric {number}": 1.0 / 3 for number in range(8)}
    text = listing([replace(summary, game=means)])[-1].plain
    assert text.startswith("  game: metric 0 0.3333, metric 1 0.3333, ")
    assert text.endswith("metric 5 0.3333 and 2 more")


def test_the_last_one_started_comes_first(small: Any) -> None:
    runs = [train(small(name=name, total_steps=64)).path for name in ("b", "a", "c")]
    for age, run in enumerate(runs):
        os.utime(run / "config.json", (1_000_000 - age, 1_000_000 - age))
    assert [summary.path.name for summary in list_runs(runs[0].parent)] == ["b", "a", "c"]


def test_a_locked_run_is_running(small: Any) -> None:
    run = train(small()).path
    with RunFolder(run).locked():
        (summary,) = list_runs(run.parent)
        assert (summary.state, summary.stop_reason) == ("running", None)
        assert [folder.path for folder in running_runs(run.parent)] == [run]
    assert running_runs(run.parent) == []
