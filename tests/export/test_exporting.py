"""Which policies of which checkpoint are exported, where to, and what bad input gets."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from ludus.errors import CheckpointError, ConfigError, EngineNotFound, ParityError
from ludus.export import exporting
from ludus.export.convert import to_model
from ludus.export.exporting import ExportConfig, export_policies, write_policies
from ludus.export.places import place_files
from ludus.export.trained import load_trained, spec_from_json
from ludus.model.json_file import read_model
from ludus.model.policy_model import PolicyModel
from ludus.networks.policy import Policy
from ludus.spec import PolicySpec
from tests.export.trained_runs import MIXED, SIMPLE, make_policy, make_run

RUN = Path("runs/r")


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Return a run with a policy and three checkpoints; the second is the best."""
    policies = {"hero": make_policy(SIMPLE)}
    return make_run(tmp_path / "run", policies, {100: 1.0, 200: 3.0, 300: 2.0})


def trained_steps(path: Path) -> float:
    """Return the agent steps of the checkpoint that a file is from."""
    return round(float(read_model(path).layers[-1].bias[0]) * 1000)


# --- which --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("checkpoint", "steps"),
    [("newest", 300), ("best", 200), ("step-000000000100", 100)],
)
def test_the_checkpoint_is_chosen(checkpoint: str, steps: int, run: Path) -> None:
    (exported,) = export_policies(ExportConfig(run=run, checkpoint=checkpoint, is_tested=False))
    assert exported.path == run / "hero.ludus.json"
    assert trained_steps(exported.path) == steps
    assert exported.num_bytes == exported.path.stat().st_size
    assert exported.parity is None


def test_a_checkpoint_may_be_named_by_path(run: Path, tmp_path: Path) -> None:
    first = run / "checkpoints/step-000000000100"
    by_run = write_policies(first, tmp_path)
    assert trained_steps(by_run["hero"]) == 100
    by_flag = write_policies(run, tmp_path, str(first))
    assert trained_steps(by_flag["hero"]) == 100


def test_every_policy_is_exported_or_the_one_that_is_named(tmp_path: Path) -> None:
    policies = {"hero": make_policy(SIMPLE), "mixed": make_policy(MIXED, seed=1)}
    run = make_run(tmp_path / "run", policies)
    both = export_policies(ExportConfig(run=run, is_tested=False))
    assert [one.path.name for one in both] == ["hero.ludus.json", "mixed.ludus.json"]
    assert read_model(both[1].path).fingerprint == MIXED.fingerprint()
    one = export_policies(
        ExportConfig(run=run, policy="mixed", to=str(tmp_path / "m.onnx"), is_tested=False)
    )
    assert [exported.path for exported in one] == [tmp_path / "m.onnx"]


def test_recorded_observations_are_loaded_if_they_fit(tmp_path: Path) -> None:
    samples = {"position": torch.arange(12.0).reshape(4, 3)}
    run = make_run(tmp_path / "a", {"hero": make_policy(SIMPLE)}, samples=samples)
    (trained,) = load_trained(run)
    assert np.array_equal(trained.recorded["position"], samples["position"].numpy())
    other = {"position": torch.zeros(4, 7)}
    run = make_run(tmp_path / "b", {"hero": make_policy(SIMPLE)}, samples=other)
    assert load_trained(run)[0].recorded == {}


@pytest.mark.parametrize("spec", [SIMPLE, MIXED], ids=lambda spec: spec.name)
def test_specs_of_checkpoints_are_read_back(spec: PolicySpec) -> None:
    read = spec_from_json(json.loads(json.dumps(spec.to_json())))
    assert replace(read, agents=spec.agents) == spec
    assert read.fingerprint() == spec.fingerprint()


# --- where to -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("to", "expected"),
    [
        (None, ["runs/r/a.ludus.json", "runs/r/b-c.ludus.json"]),
        ("models/", ["models/a.ludus.json", "models/b-c.ludus.json"]),
        ("models/{policy}.onnx", ["models/a.onnx", "models/b-c.onnx"]),
        ("{policy}/best.ludus.json", ["a/best.ludus.json", "b-c/best.ludus.json"]),
    ],
)
def test_to_names_a_file_a_folder_or_a_pattern(to: str | None, expected: list[str]) -> None:
    assert place_files(["a", "b/c"], to, RUN) == [Path(path) for path in expected]


def test_an_existing_folder_is_a_folder(tmp_path: Path) -> None:
    folder = tmp_path / "v1.onnx"
    folder.mkdir()
    assert place_files(["a"], str(folder), RUN) == [folder / "a.ludus.json"]


def test_two_policies_never_share_a_file() -> None:
    with pytest.raises(ConfigError, match=r"2 policies \(a, b\) cannot all") as error:
        place_files(["a", "b"], "m.onnx", RUN)
    assert "--policy" in error.value.hint and "{policy}.onnx" in error.value.hint
    with pytest.raises(ConfigError, match="cannot all"):
        place_files(["a/b", "a:b"], None, RUN)


@pytest.mark.parametrize(
    ("to", "hint"),
    [
        ("m.json", "did you mean m.ludus.json?"),
        ("m.onx", "did you mean m.onnx?"),
        ("m.pt", "end it in .ludus.json"),
        ("model", "or in / for a folder"),
        (".onnx", "end it in"),
    ],
)
def test_unknown_formats_are_refused(to: str, hint: str, run: Path) -> None:
    with pytest.raises(ConfigError, match="unknown format") as error:
        export_policies(ExportConfig(run=run, to=to, is_tested=False))
    assert hint in error.value.hint


# --- bad runs -----------------------------------------------------------------------------------


def test_a_missing_run_policy_or_checkpoint_is_refused(run: Path, tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match="is not a run") as error:
        write_policies(tmp_path, tmp_path)
    assert error.value.hint
    with pytest.raises(ConfigError, match="has no policy her") as unknown:
        export_policies(ExportConfig(run=run, policy="her", is_tested=False))
    assert unknown.value.hint == "did you mean hero?"
    with pytest.raises(CheckpointError, match="there is no checkpoint nowhere") as missing:
        write_policies(run, tmp_path, "nowhere")
    assert missing.value.hint
    run = make_run(tmp_path / "unfinished", {"hero": make_policy(SIMPLE)}, {1: None})
    with pytest.raises(CheckpointError, match=r"no checkpoint .* has a mean return") as best:
        write_policies(run, tmp_path, "best")
    assert "--checkpoint" in best.value.hint


def test_a_corrupt_checkpoint_is_named(run: Path, tmp_path: Path) -> None:
    tensors = run / "checkpoints/step-000000000200/tensors.safetensors"
    tensors.write_bytes(tensors.read_bytes()[:-5])
    with pytest.raises(CheckpointError, match="step-000000000200 is corrupt"):
        write_policies(run, tmp_path, "best")


def test_a_corrupt_spec_is_named(run: Path, tmp_path: Path) -> None:
    path = run / "checkpoints/step-000000000200/state.json"
    state = json.loads(path.read_text())
    del state["state_sha256"]  # as versions before it wrote them
    state["specs"]["hero"]["observation"][0]["shape"] = [4]
    path.write_text(json.dumps(state))
    with pytest.raises(CheckpointError, match="spec of policy hero is not what was saved") as error:
        write_policies(run, tmp_path, path.parent.name)
    assert "--checkpoint" in error.value.hint
    del state["specs"]["hero"]["action"]
    path.write_text(json.dumps(state))
    with pytest.raises(CheckpointError, match="spec of policy hero: KeyError: 'action'"):
        write_policies(run, tmp_path, path.parent.name)


# --- tested, or not -----------------------------------------------------------------------------


def altered_model(policy: Policy, spec: PolicySpec) -> PolicyModel:
    model = to_model(policy, spec)
    model.layers[0].weight[0, 0] += 0.1
    return model


@pytest.mark.engine
@pytest.mark.parametrize("suffix", [".ludus.json", ".onnx"])
def test_a_failed_test_leaves_the_older_file(
    suffix: str, run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    older, new = tmp_path / f"older{suffix}", tmp_path / f"new{suffix}"
    older.write_text("as it was")
    monkeypatch.setattr(exporting, "to_model", altered_model)
    for path in (older, new):
        with pytest.raises(ParityError, match="differs from PyTorch"):
            export_policies(ExportConfig(run=run, to=str(path)))
    assert older.read_text() == "as it was"
    assert sorted(tmp_path.iterdir()) == [older, run]


@pytest.fixture
def no_engine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("LUDUS_GODOT", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path / "nothing"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


@pytest.mark.usefixtures("no_engine")
def test_without_godot_games_files_are_not_tested_halfway(run: Path) -> None:
    with pytest.raises(EngineNotFound, match="cannot be tested: no Godot") as error:
        export_policies(ExportConfig(run=run))
    assert "ludus engine install godot4" in error.value.hint
    assert "--no-parity" in error.value.hint
    assert not (run / "hero.ludus.json").exists()


@pytest.mark.usefixtures("no_engine")
def test_without_godot_onnx_files_are_tested_where_they_run(run: Path, tmp_path: Path) -> None:
    (exported,) = export_policies(ExportConfig(run=run, to=str(tmp_path / "hero.onnx")))
    assert exported.parity is not None
    runtimes = [comparison.runtime for comparison in exported.parity.comparisons]
    assert runtimes == ["NumPy", "ONNX Runtime"]
    assert exported.parity.num_random > 100
