"""Networks that Godot RL Agents saved as ONNX become policy files, or one error says why not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ludus.cli.main import main
from ludus.errors import PolicyFileError
from ludus.export import gdrl_onnx
from ludus.export.config import ExportConfig
from ludus.model.inference import ModelRunner
from ludus.model.json_file import read_model
from ludus.spec import AgentSpec, ContinuousAction, DiscreteAction, ObservationEntry, PolicySpec

onnx: Any = pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")

SPEC = PolicySpec(
    name="walker",
    observation=(ObservationEntry("obs", "float32", (4,)),),
    action=(
        ContinuousAction("move", 2, -1.0, 1.0), DiscreteAction("hop", 3),
        ContinuousAction("turn", 1, -1.0, 1.0),
    ),
    agents=(AgentSpec(0, "Walker"),),
)  # fmt: skip
# Means of move, logits of hop, the mean of turn: as the game declares them.
OUTPUTS = np.array([0.5, -3.0, 0.0, 2.0, 1.0, -0.25], np.float32)


def write_network(path: Path, sizes: Sequence[int], *more: str, bias: Any = OUTPUTS) -> None:
    """Write what PyTorch's exporter makes of an MLP whose last layer gives ``bias``."""
    helper, numbers = onnx.helper, onnx.numpy_helper.from_array
    nodes = [helper.make_node("Flatten", ["obs"], ["x0"], axis=1)]
    arrays: list[Any] = []
    value = "x0"
    for i, (size, wide) in enumerate(pairwise(sizes)):
        is_last = i == len(sizes) - 2
        weight = np.zeros((wide, size)) if is_last else np.full((wide, size), 0.3)
        arrays.append(numbers(weight.astype(np.float32), f"w{i}"))
        arrays.append(numbers(bias if is_last else np.zeros(wide, np.float32), f"b{i}"))
        nodes.append(helper.make_node("Gemm", [f"x{i}", f"w{i}", f"b{i}"], [f"y{i}"], transB=1))
        operators = ["Identity"] if is_last else ["Tanh", *more]
        value = f"y{i}"
        for k, operator in enumerate(operators):
            following = f"x{i + 1}" if k == len(operators) - 1 else f"z{i}{k}"
            nodes.append(helper.make_node(operator, [value], [following]))
            value = following
    nodes.append(helper.make_node("Identity", [value], ["output"]))
    nodes.append(helper.make_node("Identity", ["state_ins"], ["state_outs"]))
    kind, rows = onnx.TensorProto.FLOAT, ["batch"]
    values = [
        helper.make_tensor_value_info(name, kind, rows if size is None else [*rows, size])
        for name, size in [("obs", sizes[0]), ("state_ins", None), ("output", sizes[-1]),
                           ("state_outs", None)]
    ]  # fmt: skip
    graph = helper.make_graph(nodes, "net", values[:2], values[2:], arrays)
    version = helper.make_opsetid("", 17)
    onnx.save(helper.make_model(graph, opset_imports=[version], ir_version=8), str(path))


@pytest.fixture
def saved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The place of a network for the game of :data:`SPEC`."""
    use_spec(monkeypatch, SPEC, tmp_path)
    return tmp_path / "walker.onnx"


def use_spec(monkeypatch: pytest.MonkeyPatch, spec: PolicySpec, folder: Path) -> None:
    def find_policy(config: ExportConfig, example: str) -> tuple[PolicySpec, Path]:
        return spec, folder / "walker.ludus.json"

    monkeypatch.setattr(gdrl_onnx, "find_policy", find_policy)


@pytest.mark.engine
def test_a_network_of_both_kinds_of_actions_computes_the_same(
    saved: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_network(saved, (4, 8, 8, 6))
    assert main(["export", str(saved), "--game", "gdrl:walkers"]) == 0
    output = capsys.readouterr().out
    assert "difference from ONNX Runtime" in output
    assert "Godot" in output
    runner = ModelRunner(read_model(saved.with_name("walker.ludus.json")))
    actions, _ = runner.act({"obs": np.zeros((1, 4), np.float32)})
    assert actions.discrete.tolist() == [[1]]
    assert actions.continuous.tolist() == [[0.5, -1.0, -0.25]]


def test_deviations_behind_means_are_left_out(saved: Path) -> None:
    outputs = np.array([0.5, -3.0, 9.0, 9.0, 0.0, 2.0, 1.0, -0.25, 9.0], np.float32)
    write_network(saved, (4, 8, 9), bias=outputs)
    exported = gdrl_onnx.export_onnx(ExportConfig(run=saved, game="gdrl:x", is_tested=False))
    assert read_model(exported.path).layers[-1].bias.tolist() == [0.0, 2.0, 1.0, 0.5, -3.0, -0.25]


def test_what_is_not_a_plain_network_is_named(saved: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(said: str) -> None:
        with pytest.raises(PolicyFileError, match=said):
            gdrl_onnx.export_onnx(ExportConfig(run=saved, game="gdrl:x", is_tested=False))

    fails("cannot read .*walker.onnx: No such file")
    saved.write_bytes(b"no network")
    fails("not an ONNX file")
    write_network(saved, (4, 8, 6), "Softplus")
    fails("a plain network has no Softplus")
    write_network(saved, (4, 8, 5), bias=np.zeros(5, np.float32))
    fails("has 5 outputs, the actions of policy walker take 6")
    write_network(saved, (5, 8, 6))
    fails("the network sees 5 numbers as 'obs', agents of policy walker see obs ")
    write_network(saved, (4, 8, 6))
    place = ObservationEntry("place", "float32", (4,))
    use_spec(monkeypatch, replace(SPEC, observation=(place,)), saved.parent)
    fails("see place")
    assert not list(saved.parent.glob("*.json"))
