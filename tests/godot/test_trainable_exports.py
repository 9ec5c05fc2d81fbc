"""Which exported games a trainer may have: debug builds, and those with the feature ``ludus``."""

from __future__ import annotations

import contextlib
import subprocess
import time
from pathlib import Path

import psutil
import pytest

from ludus.cli import main
from ludus.engine import ExportTemplate, InstalledEngine, export_game
from ludus.engine.debian import debian_template
from ludus.engine.installing import InstallerUnavailable, no_progress
from ludus.engine.prefix import bind_to_prefix
from ludus.session import LaunchOptions, open_session
from ludus.wire.handshake import EngineConfig
from tests.godot.conftest import reset, step
from tests.godot_project import AGENT_SCENE, write_project
from tests.serve.guided.test_press_play import free_port
from tests.targets import find_game

pytestmark = [pytest.mark.engine, pytest.mark.games, pytest.mark.timeout(600)]

LINE = "exported without the feature `ludus`: add it to the preset's custom features"
GAME = """\
extends Node
func apply_action(_action: int) -> void:
	pass
func get_observation() -> PackedFloat32Array:
	return [1.0]
func get_reward() -> float:
	return 1.0
func is_done() -> bool:
	return false
func reset() -> void:
	pass
"""
# Where a trainer may have the game, this node starts `ludus serve`.
GUIDED = """
[node name="Training" type="Node" parent="."]
script = ExtResource("training")
"""
TRAINING = (
    '[ext_resource path="res://addons/ludus/training/ludus_training.gd" '
    'type="Script" id="training"]\n[sub_resource'
)
DEBUG_PRESET = """\
[preset.0]
name="debug"
platform="Linux"
runnable=true
export_filter="all_resources"
[preset.0.options]
custom_template/debug="{template}"
binary_format/embed_pck=false
binary_format/architecture="x86_64"
"""


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    scene = AGENT_SCENE["godot4"].format(script="game", root="Node")
    scene = scene.replace("[sub_resource", TRAINING, 1) + GUIDED
    files = {"game.gd": GAME, "game.tscn": scene}
    return write_project(tmp_path_factory.mktemp("exports") / "project", files, main="game")


@pytest.fixture(scope="module")
def plain(
    project: Path, template: ExportTemplate, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """A release build as players get it."""
    output = tmp_path_factory.mktemp("plain") / "game.x86_64"
    return export_game(project, output, is_trainable=False)


def assert_trains(game: Path) -> None:
    with contextlib.closing(
        open_session(find_game(game), EngineConfig(), LaunchOptions(start_timeout_s=60.0))
    ) as session:
        reset(session)
        assert step(session)["agent"].reward[0] == 1.0


def test_a_release_build_with_the_feature_trains(
    project: Path, template: ExportTemplate, tmp_path: Path
) -> None:
    assert_trains(export_game(project, tmp_path / "game.x86_64"))


def test_a_debug_build_trains(project: Path, godot4: InstalledEngine, tmp_path: Path) -> None:
    try:
        (tmp_path / "template").mkdir()
        unpacked = debian_template("debug").unpack(tmp_path / "template", no_progress)
    except InstallerUnavailable as reason:
        pytest.skip(f"no debug template here: {reason}")
    assert unpacked.prefix is not None
    preset = DEBUG_PRESET.format(template=unpacked.executable)
    (project / "export_presets.cfg").write_text(preset)
    game = tmp_path / "game.x86_64"
    command = [godot4.path, "--headless", "--path", project, "--export-debug", "debug", game]
    done = subprocess.run(command, capture_output=True, timeout=300, check=False)
    assert game.is_file(), done.stderr.decode()
    bind_to_prefix(game, unpacked.prefix)
    assert_trains(game)


def test_a_release_build_without_it_says_so_at_once(
    plain: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    options = ["--num-engines", "1", "--total-steps", "100", "--runs", str(tmp_path)]
    assert main(["train", str(plain), *options]) != 0
    text = capfd.readouterr().err
    assert LINE in text
    assert "the engine ended before it connected" in text, "it does not wait for its deadline"


@pytest.mark.parametrize("argument", ["listen", "connect"])
def test_started_with_a_training_argument_it_quits(plain: Path, argument: str) -> None:
    address = f"--ludus-{argument}=tcp:127.0.0.1:{free_port()}"
    command = [plain, "--headless", "--", address]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 1
    assert [line for line in done.stderr.splitlines() if "ludus" in line] == [f"ludus: {LINE}"]


def test_it_plays_and_asks_nobody(plain: Path) -> None:
    with subprocess.Popen([plain, "--headless"]) as game:
        try:
            process = psutil.Process(game.pid)
            for _ in range(30):
                assert (process.children(), process.net_connections("all")) == ([], [])
                time.sleep(0.1)
            assert game.poll() is None
        finally:
            game.kill()
