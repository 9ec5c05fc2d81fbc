from __future__ import annotations

import errno
import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from ludus.algorithms.learner import LearnerState
from ludus.errors import CheckpointError, RunError
from ludus.runs.checkpoint import (
    Checkpoint,
    CheckpointStore,
    check_spec,
    read_checkpoint,
    write_checkpoint,
)
from ludus.spec import AgentSpec, DiscreteAction, ObservationEntry, PolicySpec


def checkpoint(steps: int = 10, mean_return: float | None = None) -> Checkpoint:
    state = LearnerState({"policy.w": torch.arange(6.0).view(2, 3), "n": torch.tensor(3)}, {"a": 1})
    return Checkpoint(steps, mean_return, {"hero": state}, {}, {"hero": "x"}, {"seed": 1}, {"u": 2})


def path_of(path: Path, _: Checkpoint) -> Path:
    return path


def test_a_checkpoint_is_read_as_it_was_written(tmp_path: Path) -> None:
    write_checkpoint(tmp_path / "c", checkpoint(mean_return=1.5))
    loaded = read_checkpoint(tmp_path / "c")
    assert (loaded.agent_steps, loaded.mean_return, loaded.run) == (10, 1.5, {"u": 2})
    tensors = loaded.learners["hero"].tensors
    assert torch.equal(tensors["policy.w"], torch.arange(6.0).view(2, 3))
    assert tensors["n"].shape == ()
    assert loaded.learners["hero"].values == {"a": 1}


def test_keeps_the_newest_and_the_best(tmp_path: Path) -> None:
    store = CheckpointStore(tmp_path, keep=2)
    for steps, mean in ((0, None), (1, 5.0), (2, 9.0), (3, -1.0), (4, 7.0), (5, 6.0)):
        store.write(checkpoint(steps, mean))
    assert [int(path.name.removeprefix("step-")) for path in store.paths()] == [2, 4, 5]
    best = store.best()
    assert best is not None
    assert best.name == "step-000000000002"
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []


def test_a_run_that_goes_on_drops_what_was_listed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = CheckpointStore(tmp_path, keep=1)
    store.write(checkpoint(1))
    listed = [store.paths()]
    store.write(checkpoint(2))
    paths = store.paths
    monkeypatch.setattr(store, "paths", lambda: listed.pop() if listed else paths())
    assert store.newest()[1].agent_steps == 2


def damage_tensors(path: Path) -> None:
    data = bytearray((path / "tensors.safetensors").read_bytes())
    data[-3] ^= 1
    (path / "tensors.safetensors").write_bytes(data)


def cut_state(path: Path) -> None:
    (path / "state.json").write_bytes((path / "state.json").read_bytes()[:-20])


def empty_state(path: Path) -> None:
    state = json.loads((path / "state.json").read_bytes())
    del state["fingerprints"], state["state_sha256"]
    (path / "state.json").write_text(json.dumps(state))


def change_state(path: Path) -> None:
    text = (path / "state.json").read_text()
    (path / "state.json").write_text(text.replace('"agent_steps": 2', '"agent_steps": 3'))


def lose_tensors(path: Path) -> None:
    (path / "tensors.safetensors").unlink()


def lose_state(path: Path) -> None:
    (path / "state.json").unlink()


def other_format(path: Path) -> None:
    (path / "state.json").write_text('{"format": 99}')


@pytest.mark.parametrize(
    ("damage", "text"),
    [
        (damage_tensors, "is corrupt: tensors.safetensors has changed"),
        (cut_state, "is corrupt: state.json"),
        (empty_state, "is corrupt: state.json lacks a field"),
        (change_state, "is corrupt: state.json has changed"),
        (other_format, "has format 99, this version reads 2"),
        (
            lose_tensors,
            "is corrupt: tensors.safetensors: No",
        ),
        (lose_state, "is corrupt: state.json"),
    ],
)
def test_corruption_is_noticed_and_an_older_one_taken(
    damage: Any, text: str, tmp_path: Path
) -> None:
    store = CheckpointStore(tmp_path, keep=3)
    good, bad = store.write(checkpoint(1)), store.write(checkpoint(2))
    damage(bad)
    with pytest.raises(CheckpointError, match=text) as info:
        read_checkpoint(bad)
    assert info.value.hint
    path, loaded = store.newest()
    assert (path, loaded.agent_steps) == (good, 1)
    assert store.paths() == [good, bad]  # only the one who trains may rename


def test_unloadable_ones_are_set_aside_and_do_not_count(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    store = CheckpointStore(tmp_path, keep=3)
    good, *others = [store.write(checkpoint(steps, float(steps))) for steps in (1, 2, 3)]
    for bad in others:
        damage_tensors(bad)
    assert store.resume(path_of) == good
    assert f"{others[1]} was renamed to unloadable-{others[1].name}" in caplog.text
    store.write(checkpoint(3))
    damage_tensors(others[1])
    assert store.resume(path_of) == good
    assert {path.name for path in tmp_path.iterdir()} == {
        "step-000000000001",
        "unloadable-step-000000000002",
        "unloadable-step-000000000003",
        "unloadable-step-000000000003-2",
    }
    new = store.write(checkpoint(2))
    assert store.paths() == [good, new]
    assert store.best() == good


def test_nothing_is_set_aside_if_none_can_be_loaded(tmp_path: Path) -> None:
    store = CheckpointStore(tmp_path, keep=2)
    bad = store.write(checkpoint())
    damage_tensors(bad)
    with pytest.raises(CheckpointError, match="no checkpoint in"):
        store.resume(path_of)
    assert store.paths() == [bad]


@pytest.mark.parametrize("write", ["write", "keep"])
def test_a_corrupt_checkpoint_of_the_same_step_is_replaced(tmp_path: Path, write: str) -> None:
    store = CheckpointStore(tmp_path, keep=2)

    def save() -> Path:
        return store.write(checkpoint()) if write == "write" else store.keep(checkpoint(), 4)

    path = save()
    before = (path / "state.json").stat().st_ino
    assert save() == path
    assert (path / "state.json").stat().st_ino == before  # left as it was
    damage_tensors(path)
    assert save() == path
    assert read_checkpoint(path).agent_steps == 10
    assert path.with_name(f"unloadable-{path.name}").is_dir()


def test_an_empty_folder_has_no_checkpoint(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match="no checkpoint in"):
        CheckpointStore(tmp_path, keep=1).newest()
    with pytest.raises(CheckpointError, match="there is no checkpoint"):
        read_checkpoint(tmp_path / "nowhere")


def test_full_disk_leaves_older_checkpoints_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = CheckpointStore(tmp_path, keep=1)
    store.write(checkpoint(1))
    calls = 0

    def fsync(_: int) -> None:
        nonlocal calls
        calls += 1
        if calls == 2:  # the first file still fits
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", fsync)
    with pytest.raises(RunError, match="the disk is full") as info:
        store.write(checkpoint(2))
    assert info.value.exit_code == 5
    assert [path.name for path in tmp_path.iterdir()] == ["step-000000000001"]
    assert store.newest()[1].agent_steps == 1


def policy(*observation: ObservationEntry, has_mask: bool = False, num: int = 2) -> PolicySpec:
    agents = (AgentSpec(0, "a"),)
    return PolicySpec("hero", observation, (DiscreteAction("move", num),), agents, 1, has_mask)


RAYS, EYES = ObservationEntry("rays", "float32", (8,)), ObservationEntry("eyes", "uint8", (2, 2, 3))


@pytest.mark.parametrize(
    ("now", "change"),
    [
        (policy(EYES), 'the observation "rays" is gone'),
        (policy(RAYS, EYES, replace(RAYS, name="night")), 'the observation "night" is new'),
        (
            policy(replace(RAYS, shape=(16,)), EYES),
            'observation "rays": shape[0] is 16 instead of 8',
        ),
        (policy(EYES, RAYS), "the observations come in another order: eyes, rays"),
        (policy(RAYS, EYES, num=3), 'action "move": n is 3 instead of 2'),
        (policy(RAYS, EYES), "the game no longer sends action masks"),
    ],
)
def test_what_has_changed_since_training_is_named(now: PolicySpec, change: str) -> None:
    trained = policy(RAYS, EYES, has_mask=True)
    saved = replace(
        checkpoint(),
        specs={"hero": trained.to_json()},
        fingerprints={"hero": trained.fingerprint()},
    )
    check_spec(saved, {"hero": trained}, Path("c"))
    with pytest.raises(CheckpointError) as caught:
        check_spec(saved, {"hero": now}, Path("c"))
    said = f"c was trained for other observations or actions of policy hero: {change}"
    assert caught.value.message == said


def test_a_change_that_does_not_show_is_refused_too() -> None:
    now = policy(RAYS)
    saved = replace(checkpoint(), specs={"hero": now.to_json()})  # of another fingerprint
    with pytest.raises(CheckpointError) as caught:
        check_spec(saved, {"hero": now}, Path("c"))
    assert caught.value.message.endswith("observations or actions of policy hero")


def test_a_checkpoint_of_other_policies_is_refused() -> None:
    with pytest.raises(CheckpointError, match="c has no policy target; it has hero"):
        check_spec(checkpoint(), {"target": policy(RAYS)}, Path("c"))
