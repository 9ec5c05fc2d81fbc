"""``--device``: trained on a GPU where that is faster, refused with a reason where none is."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch

from ludus.algorithms.learners import make_learners
from ludus.cli.main import main
from ludus.networks.device import choose_device
from ludus.pool import PoolConfig, open_pool
from ludus.settings.train_config import PPOConfig, TrainConfig

HAS_CUDA = torch.cuda.is_available()
SIZES = ["--num-worlds", "4", "--num-engines", "1", "--evaluation-episodes", "1", "--name", "run"]


@pytest.mark.cuda
@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_training_on_a_gpu(
    algorithm: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    torch.cuda.reset_peak_memory_stats()
    before = torch.cuda.max_memory_allocated()
    typed = ["train", "gym:CartPole-v1", "--algorithm", algorithm, "--device", "cuda", *SIZES]
    steps = ["--total-steps", "2000", "--sac.learning-starts", "200"]
    assert main([*typed, *steps]) == 0
    assert torch.cuda.max_memory_allocated() > before
    assert json.loads((tmp_path / "runs/run/config.json").read_text())["device"] == "cuda"
    capsys.readouterr()
    assert main(["evaluate", "runs/run", "--episodes", "1", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["policies"]


def test_a_gpu_that_is_not_there_is_refused_with_a_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["train", "gym:CartPole-v1", "--device", "cuda:99", *SIZES]) == 2
    shown = capsys.readouterr().err
    assert "device cuda:99 cannot be used: " in shown
    assert "--device cpu always works" in shown


@pytest.mark.cuda
@pytest.mark.parametrize(
    "hidden_sizes, device", [((), "cpu"), ((4096, 4096), "cuda")], ids=["small", "large"]
)
def test_auto_takes_the_faster_device(hidden_sizes: tuple[int, ...], device: str) -> None:
    config = TrainConfig(policies={"agent": PPOConfig(hidden_sizes=hidden_sizes)})
    with open_pool("gym:CartPole-v1", PoolConfig(num_worlds=16)) as pool:
        learners = make_learners(config, pool)
    assert learners["agent"].policy.device.type == device


def test_auto_takes_what_there_is() -> None:
    assert choose_device("auto").type == ("cuda" if HAS_CUDA else "cpu")
