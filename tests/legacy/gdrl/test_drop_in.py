"""Our script in the place of Godot RL Agents' `sync.gd`: installed, undone, and trained with."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import ludus
from ludus.addon import GDRL_PATH, install_addon
from ludus.cli.addon import Install, run
from ludus.engine import EngineKind, find_engine
from ludus.errors import ConfigError, TargetError
from ludus.legacy.addon import install_legacy_addon, undo_legacy_addon
from ludus.model import PolicyModel, write_model
from ludus.model.policy_model import Distribution, Linear
from ludus.play.hand import hand_player
from ludus.pool import EnginePool
from ludus.spec import ContinuousAction, DiscreteAction, PolicySpec
from ludus.spec.batch import ActionBatch, Batch

SYNC = "addons/godot_rl_agents/sync.gd"
TICKS = 4
LIMIT = 40
"""Ticks after which the controllers of the game begin again."""


def write_game(folder: Path) -> Path:
    """Write the walkers with a script of the original's path, name and exports."""
    shutil.copytree(Path(__file__).with_name("project"), folder)
    sync = folder / SYNC
    sync.parent.mkdir(parents=True)
    sync.write_bytes(b"extends Node\r\nclass_name Sync\r\n@export var action_repeat := 8\r\n")
    scene = folder / "walkers.tscn"
    text = scene.read_text().replace("res://speaker.gd", f"res://{SYNC}")
    scene.write_text(text + f"action_repeat = {TICKS}\n")
    return folder


@pytest.fixture
def game(tmp_path: Path) -> Path:
    return write_game(tmp_path / "game")


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    project = write_game(tmp_path_factory.mktemp("gdrl") / "game")
    install_legacy_addon(project)
    return project


@pytest.fixture(scope="module")
def pool(project: Path) -> Iterator[EnginePool]:
    with ludus.open_pool(str(project), ludus.PoolConfig(num_worlds=2)) as opened:
        yield opened


def tree(folder: Path) -> dict[str, bytes]:
    files = (file for file in folder.rglob("*") if file.is_file())
    return {file.relative_to(folder).as_posix(): file.read_bytes() for file in files}


def step(pool: EnginePool, *moves: float) -> Batch:
    """Move the walkers of both worlds, the two of the first one before those of the second."""
    actions = {
        "walker": ActionBatch(
            np.zeros((4, 1), np.int64), np.array([[move, 0.0] for move in moves], np.float32)
        ),
        "watcher": ActionBatch(np.ones((2, 1), np.int64), np.zeros((2, 0), np.float32)),
    }
    return pool.step(actions)["walker"]


def test_only_sync_is_replaced_and_undo_restores_it(game: Path) -> None:
    before = tree(game)
    change = install_legacy_addon(game)
    assert (change.replaced, change.kept) == ((SYNC,), "godot_rl_agents.old")
    assert (game / SYNC).read_text().startswith(f'class_name Sync\nextends "res://{GDRL_PATH}/sync')
    after = tree(game)
    assert {name for name in before if after[name] != before[name]} == {SYNC, "project.godot"}
    install_legacy_addon(game)
    assert tree(game) == after, "repeating it changes nothing"
    assert undo_legacy_addon(game) == (SYNC,)
    undone = tree(game)
    assert {name for name in before if undone[name] != before[name]} == {"project.godot"}
    assert not (game / GDRL_PATH).exists()
    assert not (game / "godot_rl_agents.old").exists()


def test_undo_refuses_to_drop_a_newer_script(game: Path) -> None:
    install_legacy_addon(game)
    (game / SYNC).write_text("extends Node\n# a newer version of the plug-in\n")
    before = tree(game)
    with pytest.raises(ConfigError, match=f"changed since the originals.*\n  {SYNC}"):
        undo_legacy_addon(game)
    assert tree(game) == before
    undo_legacy_addon(game, force=True)
    with pytest.raises(ConfigError, match="no backup"):
        undo_legacy_addon(game)


def test_bridge_refuses_a_game_with_our_script(game: Path) -> None:
    install_legacy_addon(game)
    with pytest.raises(TargetError, match="in the place of sync") as caught:
        ludus.make_vec(f"gdrl:{game}")
    assert "--undo" in (caught.value.hint or "")


def test_undo_needs_legacy(game: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run(Install(game, legacy=True))
    with pytest.raises(ConfigError, match="--legacy"):
        run(Install(game, undo=True))
    run(Install(game, legacy=True, undo=True))
    output = capsys.readouterr().out
    assert "ludus_gdrl" in output
    assert f"put back: {SYNC}\n" in output


def test_classes_are_upgraded_with_the_add_on(game: Path) -> None:
    install_legacy_addon(game)
    own = game / GDRL_PATH / "gdrl_agent.gd"
    own.unlink()
    install_addon(game)
    assert own.is_file()


@pytest.mark.engine
def test_controllers_are_agents_of_every_world(pool: EnginePool) -> None:
    walker, watcher = pool.spec.policies
    assert pool.spec.ticks_per_step == TICKS
    assert [agent.path for agent in walker.agents[:2]] == ["First/LudusAgent", "Second/LudusAgent"]
    assert [(e.name, e.dtype, e.shape) for e in (*walker.observation, *watcher.observation)] == [
        ("obs", "float32", (3,)),
        ("is_near", "float32", (2,)),
        ("camera_2d", "uint8", (2, 3, 4)),
    ]
    assert walker.action == (DiscreteAction("hop", 3), ContinuousAction("move", 2, -1.0, 1.0))


@pytest.mark.engine
def test_each_agent_gets_its_own_action_and_reward(pool: EnginePool) -> None:
    first = pool.reset(seed=1)
    image = first["watcher"].observation["camera_2d"]
    assert image[0].ravel().tolist() == [*range(23), 0]
    assert first["walker"].observation["obs"][:, 1].tolist() == [0.0] * 4
    moves = [1.0, -0.5, 0.25, 0.0]
    for total in (1.0, 2.0):
        batch = step(pool, *moves)
        assert batch.observation["obs"][:, 0].tolist() == [total * move for move in moves]
        assert batch.reward.tolist() == moves
    assert batch.observation["is_near"].tolist() == [[1, 0], [0, 1], [0, 1], [0, 1]]


@pytest.mark.engine
def test_ends_and_time_limits_are_told_apart(pool: EnginePool) -> None:
    batch = pool.reset(seed=1)["walker"]
    for number in range(1, LIMIT // TICKS):
        batch = step(pool, 1.0 if number < 5 else 0.0, 0.0, 0.0, 0.0)
        assert batch.terminated.tolist() == [number == 4, False, False, False]
        assert batch.truncated.tolist() == [False] + [number == LIMIT // TICKS - 1] * 3
    last = batch.final_observation["obs"]
    assert last[:, 1].tolist() == [LIMIT - TICKS] * 3, "the last one before the game begins again"
    assert step(pool, 0.0, 0.0, 0.0, 0.0).observation["obs"][1:, 1].tolist() == [TICKS - 1] * 3


def write_scene(path: Path, walker: str, sync: str = "", more: str = "") -> None:
    """Write a scene with one walker, our script with settings, and perhaps another node."""
    path.write_text(f"""\
[gd_scene format=3]

[ext_resource type="Script" path="res://{walker}.gd" id="1"]
[ext_resource type="Script" path="res://{SYNC}" id="2"]
[ext_resource type="Script" path="res://probe.gd" id="3"]

[node name="Walkers" type="Node"]

[node name="First" type="Node" parent="."]
script = ExtResource("1")

[node name="Sync" type="Node" parent="."]
script = ExtResource("2")
action_repeat = {TICKS}
{sync}
{more}
""")


@pytest.mark.engine
@pytest.mark.screen
def test_cameras_draw_without_being_asked_to(project: Path) -> None:
    """A game with them gets a renderer by itself; OpenGL's alpha channel is left out."""
    write_scene(project / "seers.tscn", "seer")
    config = ludus.PoolConfig(scene="res://seers.tscn", num_worlds=2)
    with ludus.open_pool(str(project), config) as opened:
        images = opened.reset(seed=1)["seer"].observation["camera_2d"]
        assert images.shape == (2, 3, 4, 3)
        for number in (1, 2):
            move = ActionBatch(np.zeros((2, 0), np.int64), np.array([[1.0], [0.5]], np.float32))
            images = opened.step({"seer": move})["seer"].observation["camera_2d"]
            for image, place in zip(images, (number, 0.5 * number), strict=True):
                assert np.unique(image.reshape(-1, 3), axis=0).tolist() == [[40 * place, 80, 160]]


@pytest.mark.engine
def test_an_unfinished_controller_is_named(project: Path) -> None:
    (project / "unfinished.gd").write_text(
        'extends "res://walker.gd"\nfunc get_action_space() -> Dictionary:\n\treturn {}\n'
    )
    write_scene(project / "unfinished.tscn", "unfinished")
    config = ludus.PoolConfig(scene="res://unfinished.tscn")
    with pytest.raises(TargetError, match=r"First .*get_action_space\(\) returns \{.*\}, expected"):
        ludus.open_pool(str(project), config)


@pytest.mark.engine
def test_a_person_plays_a_controller_that_records_demonstrations(project: Path) -> None:
    (project / "probe.gd").write_text(PROBE)
    write_scene(project / "demo.tscn", "demonstrator")
    with ludus.open_pool(str(project), ludus.PoolConfig(scene="res://demo.tscn")) as opened:
        act = hand_player(opened)
        batches = opened.reset(seed=1)
        for _ in range(2):
            actions = act(batches)
            batches = opened.step(actions)
            assert actions["walker"].discrete.tolist() == [[2]]
            assert actions["walker"].continuous.tolist() == [[0.5, -0.25]]
            assert batches["walker"].reward.tolist() == [pytest.approx(2.25)]


@pytest.mark.engine
def test_a_controller_that_records_none_says_what_is_missing(pool: EnginePool) -> None:
    batches = pool.reset(seed=1)
    with pytest.raises(TargetError, match="nobody can play policy walker by hand") as caught:
        hand_player(pool)(batches)
    assert "get_action()" in (caught.value.hint or "")


PROBE = """\
extends Node

@onready var _walker: Node = $"../First"


func _physics_process(_delta: float) -> void:
	if _walker.n_steps == 8:
		print("%s moves %.4f" % [_walker.heuristic, _walker.get("_speed")])
		get_tree().quit()
"""


def write_policy(path: Path, spec: PolicySpec) -> None:
    """Write a walker's policy that hops and moves -0.5 and 0.25, whatever it sees."""
    outputs = np.array([0.0, 1.0, 0.0, -0.5, 0.25], np.float32)
    model = PolicyModel(
        policy=spec.name,
        fingerprint=spec.fingerprint(),
        observation=spec.observation,
        action=spec.action,
        has_action_mask=False,
        normalisation=None,
        images=(),
        memory=None,
        layers=(Linear(np.zeros((5, 5), np.float32), outputs, "none"),),
        distribution=Distribution(np.zeros(2, np.float32)),
    )
    write_model(path, model)


@pytest.mark.engine
def test_exported_policy_plays_in_place_of_onnx(project: Path, pool: EnginePool) -> None:
    (project / "probe.gd").write_text(PROBE)
    settings = 'control_mode = 2\nonnx_model_path = "res://walker.onnx"\n'
    probe = '[node name="Probe" type="Node" parent="."]\nscript = ExtResource("3")\n'
    write_scene(project / "played.tscn", "walker", settings, probe)
    godot = find_engine(EngineKind.GODOT4).executable(headless=True)
    command = [str(godot), "--headless", "--fixed-fps", "60", "--quit-after", "60"]
    command += ["--path", str(project), "res://played.tscn"]

    def play() -> str:
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
        return done.stdout + done.stderr

    assert "cannot read res://walker.ludus.json" in play()
    write_policy(project / "walker.ludus.json", pool.spec.policies[0])
    assert "model moves 0.1875" in play()
