"""Converted policies compute what PyTorch computes, in NumPy and in ONNX Runtime."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any, cast, get_args

import numpy as np
import onnx
import pytest
import torch
from torch import nn

from ludus.errors import RunError
from ludus.export.convert import to_model
from ludus.export.onnx_file import RESERVED, to_onnx, write_onnx
from ludus.export.parity import PolicyFiles, measure_parity
from ludus.model.json_file import read_model, write_model
from ludus.networks.policy import Policy
from ludus.settings.policy_config import Activation
from ludus.settings.train_config import PPOConfig, SACConfig
from ludus.spec import ObservationEntry, PolicySpec
from tests.export.trained_runs import MIXED, SIMPLE, make_policy

VARIANTS: dict[str, dict[str, Any]] = {
    "plain": {},
    "memory": {"memory_size": 8},
    "frames": {"frame_stack": 3},
    "state_dependent": {"state_dependent_std": True},
    "squashed": {"squash": True},
    "all": {"memory_size": 5, "state_dependent_std": True, "squash": True},
    "not_normalised": {"normalise_observation": False},
    "no_hidden_layer": {"hidden_sizes": ()},
}


def require_equal(policy: Policy, folder: Path) -> None:
    model = to_model(policy, policy.spec)
    files = PolicyFiles(folder / "policy.ludus.json", folder / "policy.onnx")
    assert files.json is not None
    assert files.onnx is not None
    write_model(files.json, model)
    write_onnx(files.onnx, model)
    report = measure_parity(policy, model, files, None, {})
    assert [comparison.runtime for comparison in report.comparisons] == ["NumPy", "ONNX Runtime"]
    for comparison in report.comparisons:
        assert comparison.is_equal, comparison


@pytest.mark.parametrize("activation", get_args(Activation))
def test_every_activation_is_exported(activation: Activation, tmp_path: Path) -> None:
    require_equal(make_policy(SIMPLE, PPOConfig(activation=activation)), tmp_path)


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("spec", [SIMPLE, MIXED], ids=["simple", "mixed"])
def test_every_kind_of_policy_is_exported(spec: PolicySpec, variant: str, tmp_path: Path) -> None:
    settings: dict[str, Any] = {"hidden_sizes": (16, 8), **VARIANTS[variant]}
    require_equal(make_policy(spec, PPOConfig(**settings)), tmp_path)


def test_a_policy_of_sac_is_exported(tmp_path: Path) -> None:
    policy = make_policy(MIXED, SACConfig(hidden_sizes=(16, 8)))
    assert to_model(policy, policy.spec).distribution.is_squashed
    require_equal(policy, tmp_path)


@pytest.mark.parametrize("shape", [(84, 84, 1), (2, 3, 36, 40, 2)], ids=str)
def test_a_policy_with_one_large_image_is_exported(shape: tuple[int, ...], tmp_path: Path) -> None:
    entries = (ObservationEntry("camera", "uint8", shape, 0, 255),)
    spec = dataclasses.replace(SIMPLE, observation=entries)
    require_equal(make_policy(spec, noise=0.01), tmp_path)


def test_the_model_is_not_tied_to_the_network() -> None:
    policy = make_policy(SIMPLE)
    model = to_model(policy, SIMPLE)
    before = model.layers[0].weight.copy()
    with torch.no_grad():
        next(iter(policy.actor.parameters())).zero_()
    assert np.array_equal(model.layers[0].weight, before)


def test_bounds_that_are_infinite_for_some_elements_are_dropped(tmp_path: Path) -> None:
    bounds = (1.0, math.inf, 2.0)
    entry = ObservationEntry("x", "float32", (3,), (-1.0, -math.inf, -2.0), bounds)
    spec = dataclasses.replace(SIMPLE, observation=(entry,))
    model = to_model(make_policy(spec), spec)
    write_model(tmp_path / "p.ludus.json", model)
    (read,) = read_model(tmp_path / "p.ludus.json").observation
    assert (read.low, read.high) == (-math.inf, math.inf)
    assert model.fingerprint == spec.fingerprint()


def test_unknown_layers_are_refused() -> None:
    policy = make_policy(SIMPLE)
    policy.actor[1] = nn.GELU()
    with pytest.raises(RunError, match="GELU") as error:
        to_model(policy, SIMPLE)
    assert "tanh" in error.value.hint


def test_onnx_inputs_and_outputs() -> None:
    policy = make_policy(MIXED, PPOConfig(memory_size=5))
    graph = to_onnx(to_model(policy, MIXED)).graph
    inputs, outputs = describe(graph.input), describe(graph.output)
    assert inputs == {
        "rays": ("FLOAT", ["n", 4]),
        "camera": ("UINT8", ["n", 2, 12, 14, 3]),
        "ammunition": ("INT64", ["n", 2]),
        "flags": ("UINT8", ["n", 4]),
        "action_mask": ("BOOL", ["n", 5]),
        "memory": ("FLOAT", ["n", 5]),
    }
    assert outputs == {
        "memory_out": ("FLOAT", ["n", 5]),
        "outputs": ("FLOAT", ["n", 7]),
        "discrete": ("INT64", ["n", 2]),
        "continuous": ("FLOAT", ["n", 2]),
        "log_std": ("FLOAT", ["n", 2]),
    }


def describe(values: Any) -> dict[str, tuple[str, list[str | int]]]:
    types: Any = cast(Any, onnx.TensorProto.DataType)
    return {
        value.name: (
            types.Name(value.type.tensor_type.elem_type),
            [axis.dim_param or axis.dim_value for axis in value.type.tensor_type.shape.dim],
        )
        for value in values
    }


def test_onnx_leaves_out_what_the_policy_has_not() -> None:
    graph = to_onnx(to_model(make_policy(SIMPLE), SIMPLE)).graph
    assert list(describe(graph.input)) == ["position"]
    assert list(describe(graph.output)) == ["outputs", "discrete"]


def test_onnx_metadata_tell_the_spec() -> None:
    proto = to_onnx(to_model(make_policy(MIXED), MIXED))
    metadata = {prop.key: prop.value for prop in proto.metadata_props}
    assert metadata["policy"] == "mixed"
    assert metadata["fingerprint"] == MIXED.fingerprint()
    assert '"name": "camera"' in metadata["spec"]


@pytest.mark.parametrize("name", RESERVED)
def test_onnx_refuses_entries_with_names_of_its_own(name: str) -> None:
    spec = dataclasses.replace(SIMPLE, observation=(ObservationEntry(name, "float32", (3,)),))
    with pytest.raises(RunError, match=f"entry {name} has the name of another") as error:
        to_onnx(to_model(make_policy(spec), spec))
    assert "rename" in error.value.hint
