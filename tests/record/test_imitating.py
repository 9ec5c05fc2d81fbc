"""``ludus train --imitate``: what was recorded is cloned, and refused where it does not fit."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ludus
from ludus.errors import ConfigError, SetupError
from ludus.play.players import Act
from ludus.pool.interface import Pool
from ludus.record import RecordConfig
from ludus.record import dataset as dataset_module
from ludus.record.dataset import record_dataset
from ludus.spec.batch import ActionBatch, Batches
from ludus.training import loop
from tests.examples.test_key_door import WithMemory
from tests.training.environments import register

register()
IDENTITY = "gym:Identity-discrete-v0"
COMMON: dict[str, Any] = {
    "name": "run", "num_worlds": 2, "num_engines": 1, "seed": 7, "evaluation_episodes": 0,
    "ppo": {"hidden_sizes": [16], "rollout_steps": 16},
}  # fmt: skip


@pytest.fixture(autouse=True)
def datasets(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "datasets"))


def lines(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / "metrics.jsonl").read_text().splitlines()]


def record(target: str, name: str, **changes: Any) -> None:
    given: dict[str, Any] = {"is_random": True, "num_episodes": 2} | changes
    record_dataset(RecordConfig(target=target, dataset=name, **given))


def script(player: Callable[[Pool], Act]) -> Callable[[RecordConfig], Callable[[Pool], Act]]:
    """Return what takes the place of the players that a recording is made with."""
    return lambda _: player


def answering(pool: Pool) -> Act:
    """Play Identity without a mistake."""

    def act(batches: Batches) -> dict[str, ActionBatch]:
        (name,) = pool.policies
        answers = batches[name].observation["observation"].argmax(1).astype(np.int64)
        return {name: ActionBatch(answers[:, np.newaxis], np.zeros((len(answers), 0), "f4"))}

    return act


@pytest.mark.libraries
def test_a_run_begins_as_the_clone_and_resumes(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(dataset_module, "make_player", script(answering))
    record(IDENTITY, "identity/best-v0", num_episodes=10)
    imitation = {"epochs": 100, "learning_rate": 1e-2, "decay": 0.5}
    settings: dict[str, Any] = {
        "target": IDENTITY,
        "imitate": "identity/best-v0",
        "imitation": imitation,
    }
    ludus.train(**settings, **COMMON, runs=tmp_path, total_steps=96, progress=True)
    shown = capsys.readouterr().err
    assert shown.startswith("cloning identity/best-v0: pass 1 of 100  ")
    assert "\ncloned 10 episodes, 80 steps, of identity/best-v0  " in shown
    folder = tmp_path / "run"
    first = lines(folder)[0]["policies"]["agent"]
    assert first["mean_return"] > 7.0  # of 8; the untrained network has 2
    assert first["imitation_weight"] == 0.1
    ludus.train(resume=folder, total_steps=160)
    weights = [line["policies"]["agent"]["imitation_weight"] for line in lines(folder)]
    assert weights == [0.1 * 0.5**update for update in range(5)]


@pytest.mark.libraries
@pytest.mark.parametrize(
    ("target", "changes", "message"),
    [
        (IDENTITY, {"imitate": "none-v0"}, "there is no dataset none-v0"),
        ("gym:Pictures-v0", {}, "dataset a-v0 does not fit policy agent: the dataset has no "
         "observation 'image'"),
        ("gym:CartPole-v1", {}, "dataset a-v0 does not fit policy agent: actions are Discrete(4), "
         "those of the game Discrete(2)"),
        ("gym:Identity-multi_discrete-v0", {}, "observation 'observation' is Box(-1.0, 4.0, (4,), "
         "float32), that of the game Box(0.0, 1.0, (5,), float32)"),
        (IDENTITY, {"algorithm": "sac"}, "policy agent: sac does not learn from demonstrations"),
    ],
    ids=["missing", "entry", "actions", "shape", "sac"],
)  # fmt: skip
def test_what_cannot_be_imitated_is_an_error(
    target: str, changes: dict[str, Any], message: str, tmp_path: Path
) -> None:
    record(IDENTITY, "a-v0")
    settings: dict[str, Any] = {"imitate": "a-v0", "runs": tmp_path / "runs", **changes}
    with pytest.raises(ConfigError, match=re.escape(message)):
        ludus.train(target, **settings)
    assert not list((tmp_path / "runs").glob("*"))


def test_without_minari_the_package_is_named_before_a_game_starts(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def refuse() -> None:
        raise SetupError("minari is not installed", "pip install 'minari[hdf5]'")

    monkeypatch.setattr(loop, "require_minari", refuse)
    with pytest.raises(SetupError, match="minari is not installed"):
        ludus.train("no_such_game", imitate="a-v0", runs=tmp_path)


def fetching(pool: Pool) -> Act:
    """Play key_door without a mistake."""
    hero = WithMemory()

    def act(batches: Batches) -> dict[str, ActionBatch]:
        ((name, batch),) = batches.items()
        rows = batch.observation["observation"]
        chosen = [hero.act(world, row) for world, row in enumerate(rows)]
        discrete = np.array(chosen, np.int64).reshape(-1, 1)
        return {name: ActionBatch(discrete, np.zeros((len(rows), 0), np.float32))}

    return act


@pytest.mark.engine
@pytest.mark.libraries
def test_twenty_demonstrations_are_enough_for_key_door(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(dataset_module, "make_player", script(fetching))
    record("key_door", "key_door/fetch-v0", num_episodes=20)
    run = ludus.train(
        "key_door", imitate="key_door/fetch-v0", ppo={"mode": "deterministic"}, seed=1,
        num_engines=1, num_worlds=64, total_steps=1000, evaluation_episodes=200, runs=tmp_path,
    )  # fmt: skip
    assert run.evaluation["hero"].mean_return >= 0.9
