"""Checkpoints that godot-ai's own server has saved, written anew from their layout."""

from __future__ import annotations

import logging
import pickle
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
import torch
from torch import nn

from ludus.cli.main import main
from ludus.errors import CheckpointError
from ludus.export.godot_ai_file import read_godot_ai
from ludus.model.inference import ModelRunner
from ludus.model.json_file import read_model
from ludus.networks.tensors import to_numbers
from tests.legacy.godot_ai.conftest import Client, Running, Start, replays
from tests.legacy.godot_ai.test_answers import DONE

STATE = [0.5, -1.0, 2.0]


class Layers(nn.Module):
    """Linear layers with ReLU between them, under the name ``network``."""

    def __init__(self, *sizes: int) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        for inputs, outputs in pairwise(sizes):
            layers += [nn.Linear(inputs, outputs), nn.ReLU()]
        self.network = nn.Sequential(*layers[:-1])


def networks(**sizes: tuple[int, ...]) -> nn.Module:
    holder = nn.Module()
    for name, layers in sizes.items():
        holder.add_module(name, Layers(*layers))
    return holder


def contents() -> tuple[dict[str, Any], nn.Module]:
    """Return what godot-ai saves of the agent of INIT, and its actor."""
    cast(Any, torch).manual_seed(3)
    actor = networks(network=(3, 24, 24, 4))
    critic = (5, 24, 24, 24, 1)
    saved = {
        "double_q_state_dict": networks(network1=critic, network2=critic).state_dict(),
        "target_double_q_state_dict": networks(network1=critic, network2=critic).state_dict(),
        "policy_state_dict": actor.state_dict(),
        "log_alpha_state_dict": torch.tensor([-0.5], requires_grad=True),
    }
    return saved, actor


def save(project: Path, values: Any, name: str = "hero") -> Path:
    path = project / "checkpoints" / f"{name}.pt"
    path.parent.mkdir(exist_ok=True)
    torch.save(values, path)
    return path


def mean_action(actor: nn.Module) -> list[float]:
    network: Any = actor.get_submodule("network.network")
    return to_numbers(torch.tanh(network(torch.tensor([STATE]))[0, :2]))


def begin(running: Running, **changes: Any) -> tuple[Client, dict[str, Any]]:
    client = running.client()
    assert client.init(**changes) == DONE
    return client, client.ask("load", file_name="hero")


def test_the_server_goes_on_from_it(
    start: Start, project: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    saved, actor = contents()
    path = save(project, saved)
    running = start()
    client, answer = begin(running)
    assert answer == DONE
    assert f"Checkpoint loaded for hero: {path}, which godot-ai wrote" in caplog.text
    action = client.ask("get_action", file_name="hero", state=STATE)["action"]
    assert action == pytest.approx(mean_action(actor), abs=1e-6)
    client.submit(replays(40))
    assert client.train(5) == DONE
    learnt = client.ask("get_action", file_name="hero", state=STATE)["action"]
    assert learnt != action
    running.stop()
    again, _ = begin(start())
    assert again.ask("get_action", file_name="hero", state=STATE)["action"] == learnt
    assert "is left alone, as a later checkpoint is there" in caplog.text


def test_critics_targets_and_temperature_come_along(project: Path) -> None:
    saved, _ = contents()
    read = read_godot_ai(save(project, saved))
    sizes = (read.state_size, read.action_size, read.hidden_size)
    assert sizes == (3, 2, 24)
    assert (read.num_actor_layers, read.num_critic_layers) == (1, 2)
    for ours, field in (("critic", "double_q"), ("target", "target_double_q")):
        for which, network in (("first", "network1"), ("second", "network2")):
            theirs = saved[f"{field}_state_dict"][f"{network}.network.4.weight"]
            assert torch.equal(read.tensors[f"{ours}.{which}.4.weight"], theirs)
    assert to_numbers(read.tensors["log_temperature"]) == [-0.5]


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"hidden_size": 48}, "was trained with hidden_size 24, and the game says 48"),
        ({"num_critic_layers": 1}, "was trained with num_critic_layers 2, and the game says 1"),
        ({"state_dim": 4}, "was trained with state_dim 3, and the game says 4"),
    ],
)
def test_other_sizes_are_named(
    start: Start, project: Path, changes: dict[str, Any], what: str
) -> None:
    path = save(project, contents()[0])
    _, answer = begin(start(), **changes)
    assert f"hero starts over: {path} {what}" in answer["error"]


class Harmful:
    """What would make a file, were it unpickled."""

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (Path("harm-was-done"),)


def _instead(value: Any) -> Callable[[dict[str, Any]], Any]:
    return lambda _saved: value


def _with(field: str, value: Any) -> Callable[[dict[str, Any]], Any]:
    def change(saved: dict[str, Any]) -> Any:
        return {**saved, field: value}

    return change


def _change(field: str, name: str, value: Any) -> Callable[[dict[str, Any]], Any]:
    def change(saved: dict[str, Any]) -> Any:
        return {**saved, field: {**saved[field], name: value}}

    return change


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (_instead([1.0]), "file: it holds a list, expected a dictionary"),
        (_instead({}), "policy_state_dict: it is missing"),
        (_with("policy_state_dict", 3), "policy_state_dict: it is no dictionary"),
        (_with("log_alpha_state_dict", None), "log_alpha_state_dict: it is mis"),
        (
            _with("log_alpha_state_dict", torch.zeros(2)),
            "log_alpha_state_dict: it holds 2 numbers, expected 1",
        ),
        (
            _change("policy_state_dict", "network.network.2.bias", torch.zeros(7)),
            r"network.network.2: weight and bias are [[24, 24], [7]], expected [[7, 24], [7]]",
        ),
        (
            _change("double_q_state_dict", "network2.network.0.weight", torch.zeros(24, 9)),
            "double_q_state_dict: its layers are [9, 24, 24, 24, 1], expected [5, 24, 24, 24, 1]",
        ),
        (
            _change("policy_state_dict", "network.network.0.bias", torch.full((24,), np.nan)),
            "network.network.0.bias: it holds NaN or infinity",
        ),
        (
            _change("policy_state_dict", "network.norm.weight", torch.zeros(2)),
            "policy_state_dict: network.network.0.weight and so on: it is missing",
        ),
        (_with("more", Harmful()), "file: it holds more than arrays, or is"),
    ],
)  # fmt: skip
def test_other_files_are_named_with_their_field(
    change: Callable[[dict[str, Any]], Any], what: str, project: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(project)
    path = save(project, change(contents()[0]))
    with pytest.raises(CheckpointError) as caught:
        read_godot_ai(path)
    assert what in caught.value.message
    assert str(path) in caught.value.message
    assert f"PyTorch {torch.__version__}" in caught.value.hint
    assert not (project / "harm-was-done").exists()


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"no pickle", pickle.dumps(Harmful(), 2)])
def test_broken_files_are_named(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "hero.pt"
    path.write_bytes(content)
    with pytest.raises(CheckpointError, match=r"hero\.pt is not a checkpoint of godot-ai: file: "):
        read_godot_ai(path)


def test_export_makes_a_policy_file(
    project: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(project)
    saved, actor = contents()
    save(project, saved)
    assert main(["export", "checkpoints/hero.pt", "--to", "hero.ludus.json", "--no-parity"]) == 0
    assert "hero: hero.ludus.json" in capsys.readouterr().out
    model = read_model(project / "hero.ludus.json")
    assert model.spec.name == "hero"
    actions, _ = ModelRunner(model).act({"state": np.array([STATE], np.float32)})
    assert actions.continuous[0] == pytest.approx(mean_action(actor), abs=1e-6)
