"""The parity test draws what matters, and notices what is wrong."""

from __future__ import annotations

import base64
import copy
import dataclasses
import json
from pathlib import Path
from typing import Any, cast

import numpy as np
import onnx
import pytest
import torch
from numpy.typing import NDArray
from onnx import numpy_helper

from ludus.errors import ParityError
from ludus.export.compare import TOLERANCE, Comparison, compare
from ludus.export.convert import to_model
from ludus.export.inputs import ParityInputs, draw_inputs
from ludus.export.onnx_file import write_onnx
from ludus.export.parity import PolicyFiles, measure_parity, require_parity
from ludus.export.runtimes import Answers, answer_with_torch
from ludus.model.json_file import write_model
from ludus.model.policy_model import PolicyModel
from ludus.networks.policy import Policy
from ludus.settings.train_config import PPOConfig
from tests.export.trained_runs import MIXED, SIMPLE, make_policy


def written(policy: Policy, folder: Path) -> tuple[PolicyModel, PolicyFiles]:
    model = to_model(policy, policy.spec)
    json_file, onnx_file = folder / "p.ludus.json", folder / "p.onnx"
    write_model(json_file, model)
    write_onnx(onnx_file, model)
    return model, PolicyFiles(json_file, onnx_file)


# --- inputs -------------------------------------------------------------------------------------


def test_inputs_keep_within_bounds_and_reach_them() -> None:
    inputs = draw_inputs(to_model(make_policy(MIXED), MIXED), {})
    for entry in MIXED.observation:
        values = inputs.observation[entry.name]
        assert values.dtype == entry.numpy_dtype
        assert values.shape == (1, inputs.num_agents, *entry.shape)
        low, high = entry.bounds()
        assert (values >= low).all() and (values <= high).all()
        assert (values[:, 0] == low).all() and (values[:, 1] == high).all()
        assert len(np.unique(values[:, 2:])) > 2


def test_unbounded_inputs_are_typical_but_for_two_beyond_the_limit() -> None:
    model = to_model(make_policy(SIMPLE), SIMPLE)
    norm = model.normalisation
    assert norm is not None
    values = draw_inputs(model, {}).observation["position"][0]
    deviations = np.abs((values - norm.shift) * norm.scale)
    assert deviations[2:].max() <= 3.001
    assert deviations[2:].max() > 2.0
    assert (deviations[:2] > norm.limit).all()


def test_masks_leave_a_choice_of_each_component() -> None:
    inputs = draw_inputs(to_model(make_policy(MIXED), MIXED), {})
    mask = inputs.action_mask
    assert mask is not None and mask.shape == (1, inputs.num_agents, 5)
    assert mask[..., :3].any(-1).all() and mask[..., 3:].any(-1).all()
    assert mask[:, 0].all() and not mask.all()


def test_recorded_observations_come_last() -> None:
    recorded = {"position": np.random.default_rng(1).normal(size=(20, 3)).astype(np.float32)}
    inputs = draw_inputs(to_model(make_policy(SIMPLE), SIMPLE), recorded)
    assert inputs.num_recorded == 20
    last = inputs.observation["position"][0, -20:]
    assert {tuple(row) for row in last.tolist()} == {
        tuple(row) for row in recorded["position"].tolist()
    }


def test_a_memory_gets_a_sequence() -> None:
    policy = make_policy(SIMPLE, PPOConfig(memory_size=4))
    inputs = draw_inputs(to_model(policy, SIMPLE), {})
    assert inputs.num_steps > 4
    answers = answer_with_torch(policy, inputs)
    same = {name: np.repeat(x[:1], len(x), 0) for name, x in inputs.observation.items()}
    repeated = answer_with_torch(policy, dataclasses.replace(inputs, observation=same))
    assert not np.allclose(repeated.outputs[0], repeated.outputs[-1])
    assert answers.outputs.shape[0] == inputs.num_steps


# --- faults -------------------------------------------------------------------------------------


def by_name(comparisons: tuple[Comparison, ...]) -> dict[str, Comparison]:
    return {comparison.runtime: comparison for comparison in comparisons}


def test_equal_policies_pass(tmp_path: Path) -> None:
    policy = make_policy(MIXED)
    model, files = written(policy, tmp_path)
    report = measure_parity(policy, model, files, None, {})
    require_parity(report)
    assert (report.policy, report.num_recorded) == ("mixed", 0)
    assert all(0 < comparison.outputs < 1e-5 for comparison in report.comparisons)


def altered_json(path: Path) -> None:
    content = json.loads(path.read_text())
    tensor = content["layers"][0]["weight"]
    values = np.frombuffer(base64.b64decode(tensor["data"]), "<f4").copy()
    values[5] += 0.05
    tensor["data"] = base64.b64encode(values.tobytes()).decode()
    path.write_text(json.dumps(content))


def altered_onnx(path: Path) -> None:
    proto = cast(Any, onnx).load(str(path))
    weight = next(item for item in proto.graph.initializer if "weight" in item.name)
    values = numpy_helper.to_array(weight).copy()
    values.flat[5] += 0.05
    weight.CopyFrom(numpy_helper.from_array(values, weight.name))
    cast(Any, onnx).save(proto, str(path))


def test_an_altered_weight_is_noticed(tmp_path: Path) -> None:
    policy = make_policy(SIMPLE)
    model, files = written(policy, tmp_path)
    assert files.json is not None
    assert files.onnx is not None
    altered_json(files.json)
    comparisons = by_name(measure_parity(policy, model, files, None, {}).comparisons)
    assert not comparisons["NumPy"].is_equal
    assert comparisons["ONNX Runtime"].is_equal
    altered_onnx(files.onnx)
    report = measure_parity(policy, model, files, None, {})
    assert not by_name(report.comparisons)["ONNX Runtime"].is_equal
    with pytest.raises(ParityError, match=r"policy hero: NumPy differs .* allowed is 0.0001"):
        require_parity(report)


def alter_normalisation(policy: Policy) -> None:
    assert policy.encoder.normaliser is not None
    policy.encoder.normaliser.update(torch.ones(1, policy.encoder.vector_size))


def alter_deviation(policy: Policy) -> None:
    assert policy.head.log_std is not None
    with torch.no_grad():
        policy.head.log_std.add_(0.01)


def alter_image(policy: Policy) -> None:
    with torch.no_grad():
        images: Any = policy.torso.images
        next(iter(images.parameters())).add_(0.01)


def alter_memory(policy: Policy) -> None:
    assert policy.memory is not None
    with torch.no_grad():
        policy.memory.bias_hh.add_(0.01)


def test_every_part_is_compared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ludus.export.inputs.MEMORY_STEPS", 3)
    policy = make_policy(MIXED, PPOConfig(memory_size=4))
    model, files = written(policy, tmp_path)
    require_parity(measure_parity(policy, model, files, None, {}))
    for alter in (alter_normalisation, alter_deviation, alter_image, alter_memory):
        altered = copy.deepcopy(policy)
        alter(altered)
        report = measure_parity(altered, model, files, None, {})
        assert not any(comparison.is_equal for comparison in report.comparisons), alter.__name__


# --- comparing ----------------------------------------------------------------------------------


def answers(logits: NDArray[Any], chosen: int) -> Answers:
    outputs = np.asarray(logits, np.float32).reshape(1, 1, -1)
    none = np.zeros((1, 1, 0), np.float32)
    return Answers(outputs, none, np.full((1, 1, 1), chosen), none)


def compared(
    logits: list[float], best: int, came: int, mask: list[bool] | None = None
) -> Comparison:
    allowed = None if mask is None else np.asarray(mask).reshape(1, 1, -1)
    inputs = ParityInputs({"position": np.zeros((1, 1, 3), np.float32)}, allowed, 0)
    model = to_model(make_policy(SIMPLE), SIMPLE)
    values = np.asarray(logits)
    return compare("here", answers(values, best), answers(values, came), model, inputs)


def test_choices_may_differ_between_near_equals_only() -> None:
    near = compared([1.0, 0.0, 1.0 - TOLERANCE / 2, 0.0], 0, 2)
    assert near.is_equal and near.num_other_choices == 1
    far = compared([1.0, 0.0, 1.0 - TOLERANCE * 2, 0.0], 0, 2)
    assert not far.is_equal
    assert "discrete[0] of agent 0 in step 0 is 2, expected 0" in far.worst


def test_a_forbidden_choice_is_wrong() -> None:
    assert not compared([1.0, 1.0, 0.0, 0.0], 0, 1, [True, False, True, True]).is_equal


@pytest.mark.parametrize("choice", [-1, 4])
def test_a_choice_that_does_not_exist_is_wrong(choice: int) -> None:
    assert compared([1.0, 1.0, 1.0, 1.0], 0, choice).discrete == np.inf


def test_nan_and_wrong_shapes_are_wrong() -> None:
    model = to_model(make_policy(SIMPLE), SIMPLE)
    inputs = ParityInputs({"position": np.zeros((1, 1, 3), np.float32)}, None, 0)
    right = answers(np.zeros(4), 0)
    nan = answers(np.asarray([0.0, np.nan, 0.0, 0.0]), 0)
    assert not compare("here", right, nan, model, inputs).is_equal
    short = answers(np.zeros(3), 0)
    result = compare("here", right, short, model, inputs)
    assert not result.is_equal
    assert result.worst == "outputs has shape [1, 1, 3], expected [1, 1, 4]"


def test_large_numbers_are_compared_relative_to_their_size() -> None:
    model = to_model(make_policy(SIMPLE), SIMPLE)
    inputs = ParityInputs({"position": np.zeros((1, 1, 3), np.float32)}, None, 0)
    large, near = answers(np.full(4, 1000.0), 0), answers(np.full(4, 1000.05), 0)
    assert compare("here", large, near, model, inputs).is_equal
    small, far = answers(np.full(4, 0.1), 0), answers(np.full(4, 0.1 + 2e-4), 0)
    assert not compare("here", small, far, model, inputs).is_equal
