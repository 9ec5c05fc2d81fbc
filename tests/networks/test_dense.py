from __future__ import annotations

from typing import Any

import pytest
import torch
from torch import nn

from ludus.networks import dense
from ludus.networks.dense import accelerate, has_onednn
from ludus.networks.networks import perceptron


@pytest.fixture(autouse=True)
def on_any_processor(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dense, "is_worthwhile", has_onednn)


needs_onednn = pytest.mark.skipif(not has_onednn(), reason="PyTorch was built without oneDNN")


def gradients(network: Any, of: list[Any], inputs: torch.Tensor) -> tuple[torch.Tensor, Any]:
    outputs = network(inputs)
    return outputs, torch.autograd.grad(outputs.square().sum(), of)


@needs_onednn
@pytest.mark.parametrize("activation", ["relu", "tanh"])
@pytest.mark.parametrize("sizes", [(20, 160, 128, 3), (130, 200, 1), (4, 128, 128, 128, 2)])
def test_equals_the_plain_network(activation: str, sizes: Any) -> None:
    plain = perceptron(sizes, activation, 1.0)
    fast = accelerate(plain)
    assert fast is not plain
    inputs = torch.randn(130, sizes[0], requires_grad=True)
    of = [inputs, *plain.parameters()]
    expected, wanted = gradients(plain, of, inputs)
    result, got = gradients(fast, of, inputs)
    torch.testing.assert_close(result, expected, rtol=1e-4, atol=1e-5)
    for mine, theirs in zip(got, wanted, strict=True):
        torch.testing.assert_close(mine, theirs, rtol=1e-3, atol=1e-4)


@needs_onednn
def test_fixed_parameters_let_gradients_through() -> None:
    plain = perceptron((20, 128, 128, 1), "relu", 1.0)
    plain.requires_grad_(False)
    inputs = torch.randn(130, 20, requires_grad=True)
    _, (expected,) = gradients(plain, [inputs], inputs)
    _, (result,) = gradients(accelerate(plain), [inputs], inputs)
    torch.testing.assert_close(result, expected, rtol=1e-4, atol=1e-5)


def test_what_onednn_cannot_do_stays_as_it_is() -> None:
    large = (20, 200, 200, 1)
    for network in (perceptron(large, "elu", 1.0), nn.Sequential(nn.Linear(200, 200))):
        assert accelerate(network) is network


def test_small_networks_stay_as_they_are() -> None:
    network = perceptron((20, 64, 64, 1), "relu", 1.0)
    assert accelerate(network) is network


@needs_onednn
def test_where_onednn_is_slower_networks_stay_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    network = perceptron((20, 200, 200, 1), "relu", 1.0)
    assert accelerate(network) is not network
    monkeypatch.setattr(dense, "is_worthwhile", lambda: False)
    assert accelerate(network) is network


def test_a_pytorch_without_the_private_operator_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.backends.mkldnn, "is_available", lambda: True)
    monkeypatch.setattr(torch.ops, "mkldnn", object(), raising=False)
    assert not has_onednn()
