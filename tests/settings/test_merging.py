from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from ludus.errors import ConfigError
from ludus.settings.merging import Layer, python_layer, resolve, resolve_policy
from ludus.settings.plain import flatten_settings, merge_settings, read_file, to_plain
from ludus.settings.train_config import (
    LeagueConfig,
    Phase,
    PolicyConfig,
    PPOConfig,
    SACConfig,
    TrainConfig,
)
from ludus.spec import AgentSpec, DiscreteAction, ObservationEntry, PolicySpec


def policy(**settings: Any) -> PolicySpec:
    entry = ObservationEntry("o", "float32", (1,))
    agents = (AgentSpec(0, "a"),)
    return PolicySpec("hero", (entry,), (DiscreteAction("a", 2),), agents, settings=settings)


def settings_of(scene: PolicySpec, *values: dict[str, Any]) -> PolicyConfig:
    return resolve_policy([Layer("file", each) for each in values], scene)[0]


def test_scene_then_file_then_single_policy() -> None:
    scene = policy(learning_rate=0.1, discount=0.5, epochs=9.0)
    file = {"ppo": {"discount": 0.6, "gae_lambda": 0.7}, "policies": {"hero": {"gae_lambda": 0.8}}}
    settings = settings_of(scene, file)
    assert isinstance(settings, PPOConfig)
    assert (settings.learning_rate, settings.discount, settings.gae_lambda) == (0.1, 0.6, 0.8)
    assert settings.epochs == 9
    assert isinstance(settings.epochs, int)
    assert settings.clip_range == PPOConfig().clip_range


def test_python_settings_win_over_the_scene() -> None:
    layer = python_layer(TrainConfig(ppo=PPOConfig(discount=0.7)))
    settings, _ = resolve_policy([layer], policy(discount=0.5, learning_rate=0.1))
    assert (settings.discount, settings.learning_rate) == (0.7, 0.1)


def test_python_settings_of_one_policy_count_as_a_whole() -> None:
    layer = python_layer(TrainConfig(policies={"hero": PPOConfig(epochs=7)}))
    settings, _ = resolve_policy([layer], policy(discount=0.5))
    assert settings == PPOConfig(epochs=7)


def test_the_scene_chooses_the_algorithm() -> None:
    settings = settings_of(policy(algorithm="sac", batch_size=32.0))
    assert isinstance(settings, SACConfig)
    assert (settings.batch_size, settings.hidden_sizes) == (32, (256, 256))


def test_another_algorithm_drops_what_only_the_first_one_knows() -> None:
    scene = policy(clip_range=0.1, learning_rate=0.01)
    for settings in (
        settings_of(scene, {"algorithm": "sac"}),
        settings_of(scene, {"policies": {"hero": {"algorithm": "sac"}}}),
        settings_of(scene, {"ppo": {"epochs": 3}}, {"algorithm": "sac"}),
    ):
        assert isinstance(settings, SACConfig)
        assert settings.learning_rate == 0.01


def test_a_setting_of_another_algorithm_in_the_same_place_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"policy hero .scene.: sac.* has no setting clip_range"):
        settings_of(policy(algorithm="sac", clip_range=0.1))


def test_every_setting_has_its_origin() -> None:
    saved = to_plain(TrainConfig("cartpole", num_worlds=8, policies={"hero": PPOConfig(epochs=9)}))
    layers = [
        Layer("run r", saved, is_saved=True),
        Layer("file f", {"num_engines": 3, "ppo": {"discount": 0.5}}),
        Layer("command line", {"seed": 4, "total_steps": 2_000_000,
                               "policies": {"hero": {"clip_range": 0.2}}}),
    ]  # fmt: skip
    resolved = resolve(layers, {"hero": policy(gae_lambda=0.5, learning_rate=1e-3)})
    assert resolved.origins == {
        "target": "run r",
        "num_worlds": "run r",
        "num_engines": "file f",
        "ppo.discount": "file f",
        "seed": "command line",
        "total_steps": "command line",
        "policies.hero.epochs": "run r",
        "policies.hero.gae_lambda": "run r",
        "policies.hero.learning_rate": "scene",
        "policies.hero.discount": "file f",
        "policies.hero.clip_range": "command line",
    }
    rows = {name: (value, origin) for name, value, origin in resolved.rows()}
    assert rows["policies.hero.gae_lambda"] == (0.95, "run r")
    assert rows["keep_checkpoints"] == (3, "default")


def test_a_seed_is_drawn_and_a_policy_must_exist() -> None:
    resolved = resolve([], {"hero": policy()})
    assert resolved.config.seed is not None
    assert resolved.origins == {"seed": "random"}
    with pytest.raises(ConfigError, match="file: there is no policy foe") as caught:
        resolve([Layer("file", {"policies": {"foe": {}}})], {"hero": policy()})
    assert caught.value.hint == "policies of the game: hero"


def test_unknown_setting_names_policy_and_close_match() -> None:
    with pytest.raises(
        ConfigError, match=r"policy hero .scene.: unknown setting learning_rat"
    ) as info:
        settings_of(policy(learning_rat=1))
    assert info.value.hint == "did you mean learning_rate?"


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"num_worlds": "many"}, "num_worlds must be a whole number, not 'many'"),
        ({"num_worlds": 2.5}, "num_worlds must be a whole number, not 2.5"),
        ({"num_worlds": True}, "num_worlds must be a whole number, not True"),
        ({"num_worlds": 0}, "num_worlds must be at least 1, not 0"),
        ({"max_time_s": "soon"}, "max_time_s must be a number or none"),
        ({"layout": "spiral"}, "layout must be 'scene' or 'isolated' or 'grid'"),
        ({"ppo": 3}, "ppo must hold settings by name"),
        ({"ppo": {"hidden_sizes": [64, "x"]}}, "hidden_sizes must be a whole number"),
        ({"ppo": {"hidden_sizes": 64}}, "hidden_sizes must be a list of whole numbers"),
        ({"ppo": {"discount": 1.5}}, "discount must be from 0 to 1"),
        ({"policies": {"hero": {"epoch": 1}}}, "policies.hero: unknown setting epoch"),
        ({"exact_resume": True}, "exact_resume needs checkpoints at fixed updates"),
        ({"name": "../up"}, "name must be a folder name"),
        ({"schedule": 3}, "schedule must be a list of"),
        ({"schedule": [{"updates": 0}]}, "updates must be at least 1"),
        ({"schedule": [{"modes": {"hero": "idle"}}]}, r"modes.hero must be 'train' or 'frozen'"),
        ({"league": {"share": 2}}, "share must be from 0 to 1"),
        ({"sac": {"replay_capacity": 10}}, "replay_capacity must be at least batch_size, 256"),
        ({"policies": {"hero": {"algorithm": "dqn"}}}, "algorithm must be 'ppo' or 'sac'"),
        (
            {"policies": {"hero": {"batch_size": 9}}},
            "ppo, which this policy uses, has no setting batch_size",
        ),
    ],
)
def test_values_that_do_not_fit(values: dict[str, Any], text: str) -> None:
    with pytest.raises(ConfigError, match=text):
        merge_settings(TrainConfig(), values, "file")


def test_effective_settings_come_back_whole() -> None:
    config = TrainConfig(
        "cartpole", godot=Path("/opt/godot"), max_time_s=None, seed=3, checkpoint_every_s=None,
        policies={"hero": PPOConfig(hidden_sizes=(8,), target_kl=0.1), "foe": SACConfig()},
        schedule=(Phase(3, {"hero": "train", "foe": "frozen"}), Phase(2)),
        league=LeagueConfig(share=0.5, sampling="rating"),
    )  # fmt: skip
    plain = json.loads(json.dumps(to_plain(config)))
    assert merge_settings(TrainConfig(), plain, "saved") == config


def test_saved_origins_are_no_settings(tmp_path: Path) -> None:
    saved = tmp_path / "config.json"
    saved.write_text(json.dumps({**to_plain(TrainConfig("x")), "origins": {"target": "Python"}}))
    assert merge_settings(TrainConfig(), read_file(saved), "saved") == TrainConfig("x")


def test_reads_toml_and_json(tmp_path: Path) -> None:
    toml, saved = tmp_path / "a.toml", tmp_path / "a.json"
    toml.write_text("num_worlds = 3\n[ppo]\nhidden_sizes = [8, 8]\n")
    saved.write_text('{"num_worlds": 3, "ppo": {"hidden_sizes": [8, 8]}}')
    assert read_file(toml) == read_file(saved)
    assert merge_settings(TrainConfig(), read_file(toml), "file").ppo.hidden_sizes == (8, 8)


@pytest.mark.parametrize(
    ("name", "text"), [("a.toml", "x = ["), ("a.json", "{"), ("b.json", "[1]")]
)
def test_refuses_malformed_files(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(ConfigError, match=name):
        read_file(tmp_path / name)


def test_refuses_missing_files(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"cannot read .*nowhere\.toml"):
        read_file(tmp_path / "nowhere.toml")


def test_does_not_wait_for_a_pipe(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.toml")
    with pytest.raises(ConfigError, match="not a plain file"):
        read_file(tmp_path / "a.toml")


def test_functions_are_saved_as_a_command_line_names_them() -> None:
    saved = to_plain(TrainConfig("gymgodot:walk.tscn", bridge={"make_action": json.dumps}))
    assert saved["bridge"] == {"make_action": "json:dumps"}


def test_nested_settings_by_dotted_name() -> None:
    nested = {"seed": 1, "ppo": {"hidden_sizes": [8], "a": {"b": None}}, "randomise": {}}
    assert flatten_settings(nested) == {
        "seed": 1, "ppo.hidden_sizes": [8], "ppo.a.b": None, "randomise": {},
    }  # fmt: skip
