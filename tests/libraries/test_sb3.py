"""Stable-Baselines3: equal to its own DummyVecEnv, trained by four algorithms, shipped in Godot."""

# Stable-Baselines3's types are incomplete.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownParameterType=false

from __future__ import annotations

import base64
import io
import json
import os
import pickle
import zipfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, cast

import gymnasium
import numpy as np
import pytest

pytest.importorskip("sb3_contrib")

import torch
from sb3_contrib import MaskablePPO
from stable_baselines3 import DQN, PPO, SAC
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import (
    DummyVecEnv,
    VecFrameStack,
    VecMonitor,
    VecNormalize,
    VecTransposeImage,
)

import ludus
import ludus.sb3
from ludus.cli.main import main
from ludus.errors import PolicyFileError, UsageError
from ludus.export.sb3_export import export_zip
from ludus.export.sb3_zip import read_zip
from ludus.model import ModelRunner, read_model

pytestmark = [
    pytest.mark.libraries,
    pytest.mark.engine,
    pytest.mark.filterwarnings("ignore::UserWarning"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
]

NUM = 4


class Pictures(gymnasium.Env[Any, Any]):
    """Sees a picture and numbers, in an order that is not the alphabet's."""

    observation_space = gymnasium.spaces.Dict({
        "vector": gymnasium.spaces.Box(-1.0, 1.0, (3,)),
        "eye": gymnasium.spaces.Box(0, 255, (36, 40, 3), np.uint8),
        "about": gymnasium.spaces.Box(-1.0, 1.0, (2,)),
    })  # fmt: skip
    action_space = gymnasium.spaces.MultiDiscrete([3, 2])

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.observation_space.seed(seed)
        return self.observation_space.sample(), {}

    def step(self, action: Any) -> Any:
        return self.observation_space.sample(), 1.0, bool(self.np_random.random() < 0.2), False, {}


@pytest.fixture(scope="module", autouse=True)
def _pictures() -> Iterator[None]:
    only_eye = partial(gymnasium.wrappers.FilterObservation, filter_keys=["eye"])
    cast(Any, gymnasium).register("Sb3Pictures-v0", Pictures)
    cast(Any, gymnasium).register("Picture-v0", lambda: only_eye(Pictures()))
    yield
    del gymnasium.registry["Sb3Pictures-v0"], gymnasium.registry["Picture-v0"]


@pytest.fixture(scope="module")
def cartpole() -> Iterator[ludus.sb3.LudusVecEnv]:
    env = ludus.sb3.make("cartpole", num_worlds=NUM)
    yield env
    env.close()


def test_worlds_differ_though_nobody_has_set_a_seed() -> None:
    """As in ``PPO("MlpPolicy", env)``, which sets none."""
    starts: list[Any] = []
    for _ in range(2):
        env = ludus.sb3.make("cartpole", num_worlds=NUM)
        starts.extend(map(tuple, env.reset()))
        env.close()
    assert len(set(starts)) == 2 * NUM


@pytest.mark.parametrize("target", ["gym:CartPole-v1", "oracle"])
def test_bits_equal_those_of_dummy_vec_env(target: str, oracle: Path) -> None:
    game: Any = oracle if target == "oracle" else target
    own = ludus.sb3.make(game, num_worlds=NUM, layout="isolated")
    theirs = DummyVecEnv([lambda: ludus.make(game, layout="isolated")] * NUM)
    try:
        for env in (own, theirs):
            env.seed(5)
        np.testing.assert_array_equal(own.reset(), theirs.reset())
        num_ends = 0
        for step in range(60):
            actions = np.full(NUM, step % 2)
            mine, other = own.step(actions), theirs.step(actions)
            for part in range(3):
                np.testing.assert_array_equal(mine[part], other[part])
            for info, other_info in zip(mine[3], other[3], strict=True):
                assert info["TimeLimit.truncated"] == other_info["TimeLimit.truncated"]
                assert ("terminal_observation" in info) == ("terminal_observation" in other_info)
                if "terminal_observation" in info:
                    num_ends += 1
                    np.testing.assert_array_equal(
                        info["terminal_observation"], other_info["terminal_observation"]
                    )
        assert num_ends > NUM
    finally:
        own.close()
        theirs.close()


def test_make_vec_env_of_sb3_takes_our_ids() -> None:
    env: Any = make_vec_env("ludus/CartPole-v0", n_envs=2)
    env.reset()
    assert env.step(np.zeros(2, np.int64))[0].shape[0] == 2
    env.close()


def test_wrappers_of_sb3_wrap(cartpole: Any) -> None:
    env: Any = VecMonitor(VecFrameStack(VecNormalize(cartpole), 3))
    size = cartpole.observation_space.shape[0]
    assert env.reset().shape == (NUM, 3 * size)
    episodes = 0
    for _ in range(100):
        answer = env.step(np.zeros(NUM, np.int64))
        episodes += sum("episode" in info for info in answer[3])
    assert episodes > 0
    images: Any = ludus.sb3.make("gym:Picture-v0", num_worlds=2)
    assert cast(Any, VecTransposeImage(images).reset())["eye"].shape == (2, 3, 36, 40)
    images.close()


def test_what_sb3_cannot_do_is_refused(tasks: Path, cartpole: ludus.sb3.LudusVecEnv) -> None:
    with pytest.raises(UsageError, match="no actions of both kinds"):
        ludus.sb3.make(tasks / "identity_mixed.tscn")
    with pytest.raises(UsageError, match="leave autoreset_mode out"):
        ludus.sb3.make("cartpole", autoreset_mode="next_step")
    assert not cartpole.has_attr("action_masks")


CASES: list[tuple[str, Any, dict[str, Any], bool]] = [
    ("cartpole", PPO, {"n_steps": 32, "policy_kwargs": {"activation_fn": torch.nn.ELU}}, True),
    ("cartpole", DQN, {"learning_starts": 8}, False),
    ("pendulum", PPO, {"n_steps": 32}, False),
    ("pendulum", SAC, {"learning_starts": 8}, True),
    ("key_door", MaskablePPO, {"n_steps": 32}, False),
    ("gym:Sb3Pictures-v0", PPO, {"n_steps": 16, "n_epochs": 1}, False),
]


@pytest.mark.parametrize(("target", "kind", "settings", "is_normalised"), CASES)
def test_a_trained_model_plays_in_godot_as_in_python(
    target: str, kind: Any, settings: dict[str, Any], is_normalised: bool, tmp_path: Path
) -> None:
    env: Any = ludus.sb3.make(target, num_worlds=NUM)
    wrapped = VecNormalize(env) if is_normalised else env
    is_dict = isinstance(env.observation_space, gymnasium.spaces.Dict)
    model = kind("MultiInputPolicy" if is_dict else "MlpPolicy", wrapped, device="cpu", **settings)
    model.learn(NUM * 33)
    file = tmp_path / "agent.ludus.json"
    report = ludus.sb3.export(model, file)
    assert report is not None
    assert [comparison.runtime.split()[0] for comparison in report.comparisons] == [
        "NumPy",
        "Godot",
    ]
    assert all(comparison.is_equal for comparison in report.comparisons)
    # The comparison is with our reading of the weights; here with SB3 itself.
    runner = ModelRunner(read_model(file))
    seen = env.reset()
    for _ in range(20):
        known: Any = wrapped.normalize_obs(seen) if isinstance(wrapped, VecNormalize) else seen
        expected, _ = model.predict(known, deterministic=True)
        came, _ = runner.act(seen if is_dict else {"observation": seen})
        actions = came.continuous if came.continuous.size else came.discrete.reshape(expected.shape)
        np.testing.assert_allclose(actions, expected, atol=1e-4)
        seen = env.step(expected)[0]
    env.close()


def test_the_command_exports_a_zip(
    cartpole: ludus.sb3.LudusVecEnv, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = PPO("MlpPolicy", cartpole, n_steps=8, device="cpu")
    saved = tmp_path / "model.zip"
    model.save(saved)
    assert main(["export", str(saved), "--no-parity"]) == 2
    assert "--game cartpole" in capsys.readouterr().err
    assert main(["export", str(saved), "--game", "cartpole", "--to", f"{tmp_path}/"]) == 0
    assert "Godot" in capsys.readouterr().out
    assert read_model(tmp_path / "cart.ludus.json").policy == "cart"
    assert main(["export", str(saved), "--game", "pendulum", "--no-parity"]) == 2


def test_missing_statistics_are_unsafe_to_ship(
    cartpole: ludus.sb3.LudusVecEnv, tmp_path: Path
) -> None:
    wrapped = VecNormalize(cartpole)
    model = PPO("MlpPolicy", wrapped, n_steps=8, device="cpu").learn(NUM * 8)
    saved, file = tmp_path / "model.zip", tmp_path / "agent.ludus.json"
    model.save(saved)
    again = PPO.load(saved, env=cartpole, device="cpu")
    with pytest.raises(PolicyFileError, match="unsafe to ship"):
        ludus.sb3.export(again, file, is_tested=False)
    assert not file.exists()
    ludus.sb3.export(again, file, wrapped, is_tested=False)
    assert read_model(file).normalisation is not None


class Bomb:
    """Unpickled, it makes a file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> Any:
        return os.mkdir, (str(self.path),)


def change_zip(path: Path, name: str, content: bytes) -> None:
    with zipfile.ZipFile(path) as archive:
        members = {member: archive.read(member) for member in archive.namelist()}
    with zipfile.ZipFile(path, "w") as archive:
        for member, old in members.items():
            archive.writestr(member, content if member == name else old)


@pytest.fixture
def saved(cartpole: ludus.sb3.LudusVecEnv, tmp_path: Path) -> Path:
    path = tmp_path / "model.zip"
    PPO("MlpPolicy", cartpole, n_steps=8, device="cpu").save(path)
    return path


def test_a_pickle_among_the_fields_is_never_run(
    saved: Path, cartpole: ludus.sb3.LudusVecEnv, tmp_path: Path
) -> None:
    with zipfile.ZipFile(saved) as archive:
        data = json.loads(archive.read("data"))
    bomb = base64.b64encode(pickle.dumps(Bomb(tmp_path / "exploded"))).decode()
    for field in ("policy_class", "policy_kwargs", "observation_space", "lr_schedule"):
        data[field] = {**(data[field] or {}), ":type:": "<class 'dict'>", ":serialized:": bomb}
    change_zip(saved, "data", json.dumps(data).encode())
    exported = export_zip(saved, cartpole.envs.policy, tmp_path / "a.ludus.json", is_tested=False)
    assert exported.path.exists()
    assert not (tmp_path / "exploded").exists()
    with pytest.raises(Exception, match=r".*"):  # SB3 itself runs it
        PPO.load(saved)
    assert (tmp_path / "exploded").exists()


def test_a_pickle_among_the_weights_is_never_run(saved: Path, tmp_path: Path) -> None:
    stream = io.BytesIO()
    torch.save({"action_net.weight": Bomb(tmp_path / "exploded")}, stream)
    change_zip(saved, "policy.pth", stream.getvalue())
    with pytest.raises(PolicyFileError, match=r"policy\.pth: it holds more than arrays"):
        read_zip(saved)
    assert not (tmp_path / "exploded").exists()


@pytest.mark.parametrize(
    ("field", "value", "reason"),
    [
        ("policy_class", {"__module__": "mine"}, r"policy_class.__module__: it is 'mine'"),
        ("use_sde", True, "use_sde: state-dependent exploration"),
        ("policy_kwargs", {"activation_fn": "<class 'mine.Sine'>"}, "policy_kwargs.activation_fn"),
        (
            "policy_kwargs",
            {"features_extractor_class": "<class 'mine.Net'>"},
            "policy_kwargs.features_extractor_class",
        ),
    ],
)
def test_what_cannot_be_read_names_its_field(
    saved: Path, field: str, value: Any, reason: str
) -> None:
    with zipfile.ZipFile(saved) as archive:
        data = json.loads(archive.read("data"))
    change_zip(saved, "data", json.dumps({**data, field: value}).encode())
    with pytest.raises(PolicyFileError, match=reason):
        read_zip(saved)


def test_a_file_that_is_no_model_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "model.zip"
    path.write_bytes(b"no zip")
    with pytest.raises(PolicyFileError, match="not a model of Stable-Baselines3"):
        read_zip(path)
    with pytest.raises(PolicyFileError, match="cannot be read"):
        read_zip(tmp_path / "none.zip")
