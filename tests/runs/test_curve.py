"""The picture of a run's learning."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from ludus.runs.curve import draw_learning_curve, space_apart, subsample


def write_metrics(path: Path, num_updates: int, *policies: str) -> Path:
    with path.open("w") as file:
        for update in range(1, num_updates + 1):
            entry = {"mean_return": 1.0, "return_p10": 0.0, "return_p90": 2.0}
            of = dict.fromkeys(policies, entry)
            line = {"agent_steps": 10 * update, "wall_s": float(update), "policies": of}
            file.write(json.dumps(line) + "\n")
    return path


def test_few_points_stay_as_they_are() -> None:
    points = np.arange(8.0).reshape(2, 4)
    assert subsample(points, 4) is points


def test_many_points_become_means_of_neighbours() -> None:
    points = np.stack([np.arange(1000.0), np.tile([0.0, 2.0], 500)])
    sampled = subsample(points, 10)
    assert sampled.shape == (2, 10)
    assert (sampled[0, 0], sampled[0, 5], sampled[0, -1]) == (0.0, 549.5, 999.0)
    assert (sampled[1] == 1.0).all()


def test_labels_that_are_apart_stay_where_they_are() -> None:
    assert space_apart([5.0, 1.0, 3.0], 1.0) == [5.0, 1.0, 3.0]


def test_labels_at_one_height_are_moved_apart() -> None:
    assert space_apart([2.0, 2.0], 1.0) == [1.5, 2.5]
    assert space_apart([2.0, 9.0, 2.5, 2.0], 1.0) == [1.25, 9.0, 3.25, 2.25]


@pytest.mark.slow
def test_curves_of_several_policies(tmp_path: Path) -> None:
    metrics = write_metrics(tmp_path / "metrics.jsonl", 500, "hunter", "prey")
    assert draw_learning_curve(metrics, tmp_path / "curve.png", "a chase")
    with Image.open(tmp_path / "curve.png") as picture:
        assert picture.size == (1200, 675)
        colours = {colour for _, colour in picture.convert("RGB").getcolors(1 << 20) or []}
    assert {(37, 99, 235), (234, 88, 12)} <= colours


def test_without_episodes_no_curve_is_drawn(tmp_path: Path) -> None:
    assert not draw_learning_curve(tmp_path / "none.jsonl", tmp_path / "curve.png", "nothing")
    metrics = write_metrics(tmp_path / "metrics.jsonl", 3)
    assert not draw_learning_curve(metrics, tmp_path / "curve.png", "no episode ended")
    assert not (tmp_path / "curve.png").exists()
