"""NumPy inference against PyTorch's own layers, and its rules."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch.nn import functional

from ludus.errors import UsageError
from ludus.model import ModelRunner, PolicyModel
from ludus.model.frame_stack import FrameStack
from ludus.model.policy_model import Activation, Gru, ImageNetwork, Linear
from ludus.networks.tensors import as_tensor
from tests.model.golden import NUM_AGENTS, draw_mask, draw_observation
from tests.model.models import MODELS, gru, mixed, perceptron, squashed

ACTIVATIONS: dict[Activation, Any] = {
    "none": torch.nn.Identity(),
    "tanh": torch.tanh,
    "relu": torch.relu,
    "elu": functional.elu,
    "silu": functional.silu,
}


def t(array: NDArray[Any]) -> torch.Tensor:
    return as_tensor(np.ascontiguousarray(array))


def linear(layer: Linear, x: torch.Tensor) -> torch.Tensor:
    return ACTIVATIONS[layer.activation](functional.linear(x, t(layer.weight), t(layer.bias)))


def look(image: ImageNetwork, pixels: NDArray[Any]) -> torch.Tensor:
    x = t(pixels)
    if x.dim() > 4:  # as ludus.networks.networks does
        frames = x.flatten(1, x.dim() - 4).permute(0, 2, 3, 4, 1)
        x = frames.reshape(*frames.shape[:3], -1)
    x = x.permute(0, 3, 1, 2).float() / 255
    for layer in image.convolutions:
        how = {"stride": layer.stride, "padding": layer.padding}
        convolved = functional.conv2d(x, t(layer.weight), t(layer.bias), **how)
        x = ACTIVATIONS[layer.activation](convolved)
    return linear(image.linear, x.flatten(1))


def cell(memory: Gru) -> torch.nn.GRUCell:
    made = torch.nn.GRUCell(memory.weight_input.shape[1], memory.size)
    made.weight_ih.data = t(memory.weight_input)
    made.weight_hh.data = t(memory.weight_hidden)
    made.bias_ih.data = t(memory.bias_input)
    made.bias_hh.data = t(memory.bias_hidden)
    return made


def reference(
    model: PolicyModel, observation: dict[str, NDArray[Any]], state: torch.Tensor | None
) -> tuple[torch.Tensor, torch.Tensor | None]:
    images = {image.entry: image for image in model.images}
    vectors = [t(x).flatten(1).float() for name, x in observation.items() if name not in images]
    x = torch.cat(vectors, 1) if vectors else torch.zeros(NUM_AGENTS, 0)
    if model.normalisation is not None:
        limit = model.normalisation.limit
        shifted = (x - t(model.normalisation.shift)) * t(model.normalisation.scale)
        x = shifted.clamp(-limit, limit)
    x = torch.cat([x, *(look(images[name], observation[name]) for name in images)], 1)
    if model.memory is not None:
        x = state = cell(model.memory)(x, state)
    for layer in model.layers:
        x = linear(layer, x)
    return x, state


@pytest.mark.parametrize("name", MODELS)
@torch.no_grad()
def test_outputs_are_those_of_torch(name: str) -> None:
    model = MODELS[name]()
    runner, rng = ModelRunner(model), np.random.default_rng(3)
    stack = FrameStack(model.observation, model.frames, NUM_AGENTS)
    memory: NDArray[np.float32] | None = None
    state: torch.Tensor | None = None
    for _ in range(4):
        observation = stack.push(draw_observation(model, rng), np.zeros(NUM_AGENTS, np.bool_))
        outputs, memory = runner.outputs(observation, memory)
        expected, state = reference(model, observation, state)
        assert outputs.dtype == np.float32 and outputs.std() > 0.1
        np.testing.assert_allclose(outputs, expected.numpy(), atol=3e-6)
        if state is not None and memory is not None:
            np.testing.assert_allclose(memory, state.numpy(), atol=1e-6)


def test_the_best_choice_that_is_allowed() -> None:
    model, rng = mixed(), np.random.default_rng(4)
    runner = ModelRunner(model)
    observation = draw_observation(model, rng)
    logits = runner.outputs(observation)[0][:, :5]
    for _ in range(20):
        mask = draw_mask(model, rng)
        assert mask is not None
        chosen = runner.act(observation, mask)[0].discrete
        allowed = np.where(mask, logits, -np.inf)
        assert (chosen[:, 0] == allowed[:, :3].argmax(1)).all()
        assert (chosen[:, 1] == allowed[:, 3:].argmax(1)).all()
        drawn = runner.act(observation, mask, generator=rng)[0].discrete
        rows = np.arange(NUM_AGENTS)
        assert mask[rows, drawn[:, 0]].all() and mask[rows, 3 + drawn[:, 1]].all()


def test_means_are_cut_off_and_stretched() -> None:
    model = mixed()
    runner, observation = ModelRunner(model), draw_observation(model, np.random.default_rng(5))
    unit = np.clip(runner.outputs(observation)[0][:, 5:], -1, 1)
    low, high = np.array([0, 0, -0.5]), np.array([90, 90, 2])
    expected = low + (high - low) * (unit + 1) / 2
    np.testing.assert_allclose(runner.act(observation)[0].continuous, expected, rtol=1e-5)


def test_means_are_squashed_and_stretched() -> None:
    model = squashed()
    runner, observation = ModelRunner(model), draw_observation(model, np.random.default_rng(6))
    unit = np.tanh(runner.outputs(observation)[0][:, :3])
    np.testing.assert_allclose(runner.act(observation)[0].continuous, 1 + 3 * unit, atol=1e-5)


def test_draws_have_the_right_frequencies() -> None:
    model, num = perceptron("tanh"), 20_000
    runner = ModelRunner(model)
    one = {"observation": np.full((1, 5), 0.3, np.float32)}
    logits = runner.outputs(one)[0][0].astype(np.float64)
    many = {"observation": np.repeat(one["observation"], num, 0)}
    drawn = runner.act(many, generator=np.random.default_rng(7))[0].discrete[:, 0]
    expected = np.exp(logits) / np.exp(logits).sum()
    np.testing.assert_allclose(np.bincount(drawn, minlength=3) / num, expected, atol=0.015)


def test_draws_have_the_right_deviation() -> None:
    model, num = squashed(), 20_000
    runner = ModelRunner(model)
    one = {"observation": np.full((1, 6), 0.1, np.float32)}
    outputs = runner.outputs(one)[0][0]
    many = {"observation": np.repeat(one["observation"], num, 0)}
    numbers = runner.act(many, generator=np.random.default_rng(8))[0].continuous
    assert (np.abs(numbers - 1) <= 3).all()
    drawn = np.arctanh(np.clip((numbers.astype(np.float64) - 1) / 3, -1 + 1e-9, 1 - 1e-9))
    np.testing.assert_allclose(np.median(drawn, axis=0), outputs[:3], atol=0.05)
    deviations = np.exp(np.clip(outputs[3:], -5, 0.5))
    quartiles = np.quantile(drawn, [0.25, 0.75], axis=0)
    np.testing.assert_allclose((quartiles[1] - quartiles[0]) / 1.349, deviations, rtol=0.05)


def test_equal_generators_draw_equal_actions() -> None:
    model = mixed()
    runner, observation = ModelRunner(model), draw_observation(model, np.random.default_rng(9))
    first, again, other = (
        runner.act(observation, generator=np.random.default_rng(seed))[0] for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first.continuous, again.continuous)
    np.testing.assert_array_equal(first.discrete, again.discrete)
    assert (first.continuous != other.continuous).any()


def test_a_memory_of_zeros_begins_an_episode() -> None:
    model = gru()
    runner, observation = ModelRunner(model), draw_observation(model, np.random.default_rng(1))
    first, memory = runner.outputs(observation)
    assert memory is not None
    later, _ = runner.outputs(observation, memory)
    assert (first != later).any()
    memory[2] = 0.0
    begun, _ = runner.outputs(observation, memory)
    np.testing.assert_array_equal(begun[2], first[2])
    np.testing.assert_array_equal(begun[1], later[1])


def test_wrong_inputs_are_named() -> None:
    runner = ModelRunner(mixed())
    right = draw_observation(mixed(), np.random.default_rng(1))
    with pytest.raises(UsageError, match='no entry "near"'):
        runner.act({"rays": right["rays"]})
    with pytest.raises(UsageError, match=r'observation\["rays"\]: expected shape \[5, 2, 3\]'):
        runner.act({**right, "rays": right["rays"].reshape(5, 6)})
    with pytest.raises(UsageError, match=r"action_mask: expected shape \[5, 5\]"):
        runner.act(right, np.ones((5, 3), np.bool_))
    memory = np.zeros((1, 6), np.float32)
    with pytest.raises(UsageError, match=r"memory: expected shape \[5, 6\]"):
        ModelRunner(gru()).act(draw_observation(gru(), np.random.default_rng(1)), None, memory)
