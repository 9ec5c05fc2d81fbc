"""`ludus record --overlay`: the film shows what an agent sees, and is otherwise the same."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from ludus.errors import TargetError
from ludus.record import RecordConfig, record
from tests.godot_project import AGENT_SCENE, write_project
from tests.record.games import frames_of, ticks_project

pytestmark = [pytest.mark.engine, pytest.mark.screen, pytest.mark.timeout(240)]


# The camera looks at a magenta box that the window does not show.
CAMERA_GAME = """\
extends Node2D
func apply_action(_action: int) -> void: pass
func get_reward() -> float: return 0.0
func is_done() -> bool: return false
func reset() -> void: pass
"""
CAMERA_NODES = """\
[node name="Box" type="Polygon2D" parent="."]
position = Vector2(5000, 5000)
color = Color(1, 0, 1, 1)
polygon = PackedVector2Array(-100, -100, 100, -100, 100, 100, -100, 100)
[node name="Eye" type="Node2D" parent="."]
position = Vector2(5000, 5000)
script = ExtResource("4")
width = 8
height = 8
seen_size = Vector2(100, 100)
"""
CAMERA = (
    '[ext_resource path="res://addons/ludus/cameras/ludus_camera_2d.gd" type="Script" id="4"]\n'
)


def film(project: Path, out: Path, *, has_overlay: bool) -> list[NDArray[np.uint8]]:
    recorded = record(
        RecordConfig(
            target=str(project),
            out=out,
            is_random=True,
            seconds=1.0,
            window=(640, 480),
            has_overlay=has_overlay,
        )
    )
    frames = frames_of(out)
    assert len(frames) == recorded.num_frames
    return frames


def test_the_film_is_the_same_beside_the_view(tmp_path: Path, films: Path) -> None:
    project = ticks_project(tmp_path / "game", "godot4")
    plain = film(project, films / "plain.mp4", has_overlay=False)
    shown = film(project, films / "shown.mp4", has_overlay=True)
    assert len(plain) == len(shown) == 30
    for one, other in zip(plain, shown, strict=True):
        difference = np.abs(one.astype(int) - other.astype(int)).mean(axis=2)
        assert difference[:26, :320].mean() < 6, "above the view the game is the same"
        assert difference[60:170, 20:300].mean() > 8, "the view covers the game"
    one, other = (shown[i][180:400, 10:340].astype(int) for i in (5, 25))
    assert np.abs(one - other).max() > 60, "the view moves"


def test_the_view_shows_the_picture_of_a_camera(tmp_path: Path, films: Path) -> None:
    scene = AGENT_SCENE["godot4"].format(script="game", root="Node2D")
    scene = scene.replace("[sub_resource", f"{CAMERA}[sub_resource", 1) + CAMERA_NODES
    files = {"game.gd": CAMERA_GAME, "game.tscn": scene}
    project = write_project(tmp_path / "game", files, main="game")
    frame = film(project, films / "eye.mp4", has_overlay=True)[-1]
    is_magenta = (frame[..., 0] > 180) & (frame[..., 1] < 80) & (frame[..., 2] > 180)
    rows, columns = np.nonzero(is_magenta)
    assert np.ptp(rows) + 1 == pytest.approx(120, abs=4), "the height of a picture in the view"
    assert np.ptp(columns) + 1 == pytest.approx(120, abs=4)


def test_only_godot_4_has_the_view(tmp_path: Path, films: Path) -> None:
    project = ticks_project(tmp_path / "game", "godot3")
    with pytest.raises(TargetError, match=r"--overlay shows .* Godot 4 project"):
        film(project, films / "film.mp4", has_overlay=True)
