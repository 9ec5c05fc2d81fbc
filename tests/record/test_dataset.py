"""``ludus record --dataset``: Minari reads every step back, and makes the game again."""

from __future__ import annotations

import importlib
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ludus
from ludus.addon import install_addon
from ludus.cli.main import main
from ludus.errors import ConfigError, RunError, SetupError, TargetError
from ludus.play.hand import hand_player
from ludus.pool import EnginePool, PoolConfig, open_pool
from ludus.record import RecordConfig
from ludus.record.dataset import record_dataset
from tests.godot.conftest import PROJECT
from tests.targets import find_scene
from tests.training.environments import register

register()


@pytest.fixture(autouse=True)
def datasets(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "datasets"))


@pytest.mark.libraries
def test_every_step_is_kept_as_it_was_played(capsys: pytest.CaptureFixture[str]) -> None:
    minari: Any = importlib.import_module("minari")
    target = "gym:Identity-continuous-v0"
    command = ["record", target, "--dataset", "identity/random-v0", "--random", "--episodes", "5"]
    assert main([*command, "--num-worlds", "2", "--seed", "3"]) == 0
    assert capsys.readouterr().out == "identity/random-v0: 5 episodes, 40 steps of policy agent\n"
    found: Any = minari.load_dataset("identity/random-v0")
    episodes = list(found.iterate_episodes())
    assert [len(episode.rewards) for episode in episodes] == [8] * 5
    assert {len(episode.observations) for episode in episodes} == {9}
    for episode in episodes:
        assert episode.terminations.tolist() == [False] * 7 + [True]
        answers = episode.observations[:-1]
        rewards = -np.abs((episode.actions - 2.0) / 4.0 - answers).mean(1)
        assert np.allclose(episode.rewards, rewards, atol=1e-5)


@pytest.mark.libraries
def test_images_are_stored_without_loss_and_masks_beside_them() -> None:
    minari: Any = importlib.import_module("minari")
    for target, name in (("gym:Pictures-v0", "pictures-v0"), ("gym:Masked-v0", "masked-v0")):
        record_dataset(RecordConfig(target=target, dataset=name, is_random=True, num_episodes=3))
    pictures: Any = minari.load_dataset("pictures-v0")
    images: Any = next(iter(pictures.iterate_episodes())).observations["image"]
    assert sorted(np.unique(images[0]).tolist()) == [0, 200]
    masked: Any = minari.load_dataset("masked-v0")
    episode = next(iter(masked.iterate_episodes()))
    allowed = episode.infos["action_mask"]
    assert allowed[np.arange(len(episode.actions)), episode.actions].all()


@pytest.mark.engine
@pytest.mark.libraries
@pytest.mark.filterwarnings("default")
def test_a_slot_that_stays_empty_is_not_waited_for() -> None:
    scene = find_scene("godot4:identity").project.root / "examples/identity/oracle_world.tscn"
    config = RecordConfig(target=str(scene), dataset="oracle-v0", is_random=True, num_episodes=6)
    written = record_dataset(config)
    # Two runners, and a place for a third.
    assert {each.policy: each.num_episodes for each in written} == {"runner": 6, "watcher": 6}


@pytest.mark.libraries
def test_endless_episodes_give_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ludus.record.dataset.MAX_STEPS", 20)
    config = RecordConfig(
        target="gym:Endless-v0", dataset="endless-v0", is_random=True, num_episodes=3
    )
    message = "policy agent: 0 of 3 episodes ended, and none in the last 20 steps\nhint: set max_ep"
    with pytest.raises(RunError, match=message):
        record_dataset(config)


@pytest.mark.libraries
def test_many_episodes_may_take_more_steps_than_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ludus.record.dataset.MAX_STEPS", 5)
    (written,) = record_dataset(
        RecordConfig(
            target="gym:Truncated-v0", dataset="truncated-v0", is_random=True, num_episodes=8
        )
    )
    assert written.num_steps == 40


@pytest.mark.engine
@pytest.mark.libraries
@pytest.mark.filterwarnings("default")
def test_a_godot_game_is_recovered_from_its_dataset(tmp_path: Path) -> None:
    minari: Any = importlib.import_module("minari")
    run = ludus.train(
        "cartpole", runs=tmp_path, name="run", num_worlds=8, num_engines=1, total_steps=4096,
        evaluation_episodes=0,
    )  # fmt: skip
    (written,) = record_dataset(
        RecordConfig(target=str(run.path), dataset="cartpole/trained-v0", num_episodes=2, seed=7)
    )
    assert written.num_episodes == 2
    found: Any = minari.load_dataset("cartpole/trained-v0")
    env: Any = found.recover_environment()
    try:
        assert env.observation_space == found.observation_space
        episode = next(iter(found.iterate_episodes()))
        observation, _ = env.reset(seed=7)
        assert np.array_equal(observation, episode.observations[0])
        terminated = truncated = False
        for number, action in enumerate(episode.actions):
            observation, reward, terminated, truncated, _ = env.step(action)
            assert np.array_equal(observation, episode.observations[number + 1])
            assert reward == pytest.approx(episode.rewards[number])
        assert (terminated, truncated) == (episode.terminations[-1], episode.truncations[-1])
    finally:
        env.close()


# A person holds the right arrow; one agent walks, the other turns, too.
PLAYED = """\
extends LudusAgent
func _init() -> void:
	action = [LudusActionComponent.discrete("move", 3)]
	observation = [LudusObservationEntry.create("steps", [1])]
	Input.action_press(&"ui_right")
func get_manual_action() -> Variant:
	return 1 + int(Input.get_axis(&"ui_left", &"ui_right"))
func apply_action(_action: Variant) -> void:
	pass
func get_observation() -> Array:
	return [0.0]
func get_reward() -> float:
	return 0.0
func is_done() -> bool:
	return false
func reset() -> void:
	pass
"""
BOTH = PLAYED.replace("3)]", '3), LudusActionComponent.continuous("turn", 2, -1.0, 1.0)]').replace(
    'return 1 + int(Input.get_axis(&"ui_left", &"ui_right"))',
    'return {"move": 2, "turn": [Input.get_axis(&"ui_left", &"ui_right"), -0.5]}',
)
SCENE = """\
[gd_scene load_steps=3 format=3]
[ext_resource type="Script" path="res://played.gd" id="1"]
[ext_resource type="Script" path="res://both.gd" id="2"]
[node name="Game" type="Node"]
[node name="Walker" type="Node" parent="."]
script = ExtResource("1")
policy_name = "walker"
[node name="Both" type="Node" parent="."]
script = ExtResource("2")
policy_name = "both"
"""


def opened_game(folder: Path, files: Mapping[str, str]) -> EnginePool:
    """Write a project with the add-on into a folder, and open it."""
    for name, text in {"project.godot": PROJECT, **files}.items():
        (folder / name).write_text(text)
    install_addon(folder)
    return open_pool(folder, PoolConfig())


@pytest.mark.engine
def test_a_person_plays_by_the_keys_of_the_game(tmp_path: Path) -> None:
    files = {"played.gd": PLAYED, "both.gd": BOTH, "right.tscn": SCENE}
    with opened_game(tmp_path, files) as pool:
        act = hand_player(pool)
        batches = pool.reset(1)
        for _ in range(2):
            actions = act(batches)
            batches = pool.step(actions)
            assert actions["walker"].discrete.tolist() == [[2]]
            assert actions["both"].discrete.tolist() == [[2]]
            assert actions["both"].continuous.tolist() == [[1.0, -0.5]]


# A game in turns: a key is pressed in every fifth frame, and null means that none was.
TURNS = """\
extends LudusAgent
var _frames := 0
var _moves := 0
var _pressed: Variant = null
func _init() -> void:
	ticks_per_step = 1
	action = [LudusActionComponent.discrete("digit", 10)]
	observation = [LudusObservationEntry.create("counts", [2])]
func _process(_delta: float) -> void:
	_frames += 1
	if _frames % 5 == 0:
		var key := InputEventKey.new()
		key.keycode = (KEY_0 + _frames / 5) as Key
		key.pressed = true
		get_viewport().push_input(key)
func _unhandled_key_input(event: InputEvent) -> void:
	_pressed = (event as InputEventKey).keycode - KEY_0
func get_manual_action() -> Variant:
	var chosen: Variant = _pressed
	_pressed = null
	return chosen
func apply_action(_digit: int) -> void:
	_moves += 1
func get_observation() -> Array:
	return [_frames, _moves]
func get_reward() -> float:
	return 0.0
func is_done() -> bool:
	return false
func reset() -> void:
	pass
"""
TURNS_SCENE = """\
[gd_scene load_steps=2 format=3]
[ext_resource type="Script" path="res://turns.gd" id="1"]
[node name="Game" type="Node"]
[node name="Player" type="Node" parent="."]
script = ExtResource("1")
"""


@pytest.mark.engine
def test_no_step_passes_until_a_person_has_chosen(tmp_path: Path) -> None:
    with opened_game(tmp_path, {"turns.gd": TURNS, "right.tscn": TURNS_SCENE}) as pool:
        act = hand_player(pool)
        batches = pool.reset(1)
        for turn in (1, 2, 3):
            actions = act(batches)
            assert actions["agent"].discrete.tolist() == [[turn]]
            batches = pool.step(actions)
            ((frames, moves),) = batches["agent"].observation["counts"].tolist()
            assert moves == turn
            assert 5 * turn <= frames < 5 * (turn + 1)


def test_a_game_without_keys_cannot_be_played_by_hand() -> None:
    with open_pool("gym:CartPole-v1", PoolConfig()) as pool:
        act = hand_player(pool)
        with pytest.raises(TargetError, match="nobody can play policy agent by hand"):
            act(pool.reset(1))


@pytest.mark.libraries
@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"dataset": "no version"}, "'no version' is not a valid dataset name"),
        ({"policy": (Path("none"),), "is_random": False}, "there is no run or policy file none"),
    ],
    ids=str,
)
def test_what_cannot_be_written_is_an_error(changes: dict[str, Any], message: str) -> None:
    given: dict[str, Any] = {"target": "gym:CartPole-v1", "dataset": "a-v0", "is_random": True}
    with pytest.raises(ConfigError, match=re.escape(message)):
        record_dataset(RecordConfig(**{**given, **changes}))


@pytest.mark.libraries
def test_a_dataset_is_never_replaced() -> None:
    config = RecordConfig(target="gym:CartPole-v1", dataset="a-v0", is_random=True, num_episodes=1)
    record_dataset(config)
    with pytest.raises(ConfigError, match="the dataset a-v0 exists already"):
        record_dataset(config)


def test_without_minari_the_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def find_nothing(_: str) -> None:
        return None

    monkeypatch.setattr("importlib.util.find_spec", find_nothing)
    with pytest.raises(SetupError, match=r"minari is not installed\nhint: pip install 'minari"):
        record_dataset(RecordConfig(target="gym:CartPole-v1", dataset="a-v0", is_random=True))


def test_something_must_be_named_to_write(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["record", "gym:CartPole-v1", "--random"]) == 2
    assert "--dataset NAME-v0 for Minari" in capsys.readouterr().err


@pytest.mark.libraries
def test_a_game_of_a_legacy_bridge_cannot_be_played_by_hand() -> None:
    config = RecordConfig(target="gdrl:127.0.0.1:1", dataset="walk/person-v0")
    with pytest.raises(TargetError, match="nobody can play gdrl:") as caught:
        record_dataset(config)
    assert "--random" in caught.value.hint
