"""NumPy inference gives what the golden policies say."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from ludus.model import ModelRunner, PolicyModel, read_model
from ludus.model.frame_stack import FrameStack
from ludus.model.json_file import to_json
from tests.model.golden import FOLDER, cases_path, model_path, read_cases
from tests.model.models import MODELS


def test_every_model_has_its_files() -> None:
    expected = {path for name in MODELS for path in (model_path(name), cases_path(name))}
    assert set(FOLDER.iterdir()) == expected


@pytest.mark.parametrize("name", MODELS)
def test_the_file_holds_the_model(name: str) -> None:
    assert json.loads(model_path(name).read_text()) == to_json(MODELS[name]())


@pytest.mark.parametrize("name", MODELS)
def test_numpy_computes_the_golden_cases(name: str) -> None:
    model = read_model(model_path(name))
    runner, cases = ModelRunner(model), read_cases(name)
    num_agents = cases["num_agents"]
    memory = np.zeros((num_agents, runner.memory_size), np.float32)
    stack = FrameStack(model.observation, model.frames, num_agents)
    for step in cases["steps"]:
        begins: list[int] = step["begins"]
        memory[begins] = 0.0
        before = memory if runner.memory_size else None
        observation, mask = inputs(model, step)
        is_first = np.zeros(num_agents, np.bool_)
        is_first[begins] = True
        observation = stack.push(observation, is_first)
        outputs, _ = runner.outputs(observation, before)
        np.testing.assert_allclose(outputs, step["outputs"], atol=2e-6)
        actions, after = runner.act(observation, mask, before)
        assert actions.discrete.tolist() == step["discrete"]
        expected = np.array(step["continuous"], np.float32).reshape(actions.continuous.shape)
        np.testing.assert_allclose(actions.continuous, expected, rtol=1e-5, atol=1e-5)
        if after is not None:
            np.testing.assert_allclose(after, step["memory"], atol=2e-6)
            memory = after


def test_cases_tell_wrong_choices_apart() -> None:
    """Between the best and the next best logit there is more than rounding."""
    for name in MODELS:
        model = read_model(model_path(name))
        for step in read_cases(name)["steps"]:
            outputs = np.array(step["outputs"], np.float64)
            start = 0
            for n in model.spec.nvec:
                ordered = np.sort(outputs[:, start : start + n], axis=1)
                assert (ordered[:, -1] - ordered[:, -2] > 1e-4).all(), name
                start += n


def inputs(
    model: PolicyModel, step: dict[str, Any]
) -> tuple[dict[str, NDArray[Any]], NDArray[np.bool_] | None]:
    observation = {
        entry.name: np.array(step["observation"][entry.name], entry.numpy_dtype).reshape(
            -1, *entry.shape
        )
        for entry in model.observation
    }
    mask = step["action_mask"]
    return observation, None if mask is None else np.array(mask, np.bool_)
