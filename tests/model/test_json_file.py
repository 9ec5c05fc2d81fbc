"""Policy files are read as they were written, and nothing wrong is read at all."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

from ludus.errors import PolicyFileError
from ludus.model import PolicyModel, read_model, write_model
from ludus.model.json_file import from_json, to_json
from tests.model.models import MODELS, gru, mixed
from tests.wire.strategies import json_values


def described(model: PolicyModel) -> str:
    return json.dumps(to_json(model))


@pytest.mark.parametrize("name", MODELS)
def test_a_policy_is_read_as_it_was_written(name: str, tmp_path: Path) -> None:
    model = MODELS[name]()
    path = tmp_path / "a.ludus.json"
    write_model(path, model)
    read = read_model(path)
    assert described(read) == described(model)
    assert read.fingerprint == read.spec.fingerprint() == model.fingerprint
    assert [file.name for file in tmp_path.iterdir()] == ["a.ludus.json"]


def test_arrays_are_float32_of_their_shape() -> None:
    read = from_json(to_json(gru()))
    assert read.memory is not None and read.memory.weight_hidden.shape == (18, 6)
    assert read.memory.weight_hidden.dtype == np.float32
    written = gru().memory
    assert written is not None
    np.testing.assert_array_equal(read.memory.weight_hidden, written.weight_hidden)


Change = Callable[[dict[str, Any]], object]
NAN = {"shape": [1], "data": "AADAfw=="}

MISTAKES: dict[str, tuple[Change, str]] = {
    "another format": (lambda j: j.update(format="onnx"), "format: expected"),
    "a later version": (lambda j: j.update(version=2), "version: expected 1, got 2"),
    "no layers": (lambda j: j.update(layers=[]), "layers: expected 1 to 64"),
    "a key is missing": (lambda j: j.pop("images"), "images: expected a value, got nothing"),
    "an image without entry": (
        lambda j: j["images"].append(
            {"entry": "x", "convolutions": [], "linear": j["layers"][0]},
        ),
        "images: expected one for each of []",
    ),
    "an unknown dtype": (
        lambda j: j["observation"][0].update(dtype="float64"),
        "observation[0].dtype: expected one of",
    ),
    "an entry that has grown": (
        lambda j: j["observation"][0].update(shape=[4]),
        "normalisation.shift.shape: expected [4], got [3]",
    ),
    "an action that has grown": (
        lambda j: j["action"][0].update(n=5),
        "layers[1].bias.shape: expected [6], as action and distribution ask for, got [5]",
    ),
    "a mask without choice": (
        lambda j: j.update(action=[j["action"][1]], has_action_mask=True),
        "has_action_mask: there is no discrete action",
    ),
    "another memory": (lambda j: j["memory"].update(kind="lstm"), 'memory.kind: expected "gru"'),
    "memory of another size": (
        lambda j: j["memory"].update(bias_hidden=j["layers"][0]["bias"]),
        "memory.bias_hidden.shape: expected [18], got [5]",
    ),
    "an unknown activation": (
        lambda j: j["layers"][0].update(activation="gelu"),
        "layers[0].activation: expected one of none, tanh",
    ),
    "no base64": (
        lambda j: j["layers"][0]["bias"].update(data="*"),
        "layers[0].bias.data: expected base64",
    ),
    "too few bytes": (
        lambda j: j["layers"][0]["bias"].update(data="AAAA"),
        "layers[0].bias.data: expected 20 bytes for [5] float32, got 3",
    ),
    "a fraction of a size": (
        lambda j: j["layers"][0]["bias"].update(shape=[2.5]),
        "layers[0].bias.shape[0]: expected an integer, got 2.5",
    ),
    "a huge shape": (
        lambda j: j["layers"][0]["bias"].update(shape=[1 << 20, 1 << 20]),
        "layers[0].bias.shape: expected 1 to 4 sizes of at most",
    ),
    "not a number": (
        lambda j: j["distribution"].update(log_std=NAN),
        "distribution.log_std[0]: expected a finite number, got nan",
    ),
    "a range upside down": (
        lambda j: j["distribution"].update(log_std_range=[2, -20]),
        "distribution.log_std_range: expected [lowest, highest], got [2.0, -20.0]",
    ),
    "a text for a flag": (
        lambda j: j["distribution"].update(is_squashed="no"),
        "distribution.is_squashed: expected true or false, got 'no'",
    ),
    "no limit": (
        lambda j: j["normalisation"].update(limit=0),
        "normalisation.limit: expected a positive number",
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_names_the_field(mistake: str) -> None:
    change, expected = MISTAKES[mistake]
    value = to_json(gru())
    change(value)
    with pytest.raises(PolicyFileError) as caught:
        from_json(value)
    assert caught.value.message.startswith("policy file: " + expected), caught.value.message


def test_mistakes_in_convolutions_name_the_field() -> None:
    value = to_json(MODELS["camera"]())
    layer = value["images"][0]["convolutions"][1]
    for key, wrong, expected in [
        ("stride", 0, "stride: expected 1 to 65536, got 0"),
        ("padding", 3, "padding: expected 0 to less than the kernel, got 3"),
        ("stride", 9, None),
    ]:
        right, layer[key] = layer[key], wrong
        with pytest.raises(PolicyFileError) as caught:
            from_json(value)
        layer[key] = right
        place = f"policy file: images[0].convolutions[1].{expected}" if expected else "policy file"
        assert caught.value.message.startswith(place), caught.value.message


def test_a_wrong_model_is_not_written(tmp_path: Path) -> None:
    model = mixed()
    model.layers[0].weight[0, 0] = np.nan
    with pytest.raises(PolicyFileError, match=r"layers\[0\].weight\[0, 0\]"):
        write_model(tmp_path / "a.ludus.json", model)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (b"", "not JSON"),
        (b"\xff\xfe", "not JSON"),
        (b"[" * 100_000, "nested too deeply"),
        (b'{"format": NaN}', "NaN is not JSON"),
        (b"[]", "the whole: expected an object, got list"),
    ],
)
def test_a_broken_file_is_named(text: bytes, expected: str, tmp_path: Path) -> None:
    path = tmp_path / "broken.ludus.json"
    path.write_bytes(text)
    with pytest.raises(PolicyFileError, match=expected) as caught:
        read_model(path)
    assert str(path) in caught.value.message


def test_files_that_cannot_be_reached(tmp_path: Path) -> None:
    with pytest.raises(PolicyFileError, match="cannot read policy file"):
        read_model(tmp_path / "nothing.ludus.json")
    with pytest.raises(PolicyFileError, match="cannot write policy file"):
        write_model(tmp_path / "no folder" / "a.ludus.json", gru())


PLACES = [to_json(make()) for make in (gru, mixed, MODELS["camera"])]


@st.composite
def damaged(draw: st.DrawFn) -> Any:
    """A policy file in which one value, anywhere, is another or missing."""
    value: Any = copy.deepcopy(draw(st.sampled_from(PLACES)))
    part = value
    while True:
        keys: list[Any] = (
            list(range(len(cast(list[Any], part)))) if isinstance(part, list) else sorted(part)
        )
        key = draw(st.sampled_from(keys))
        inner: Any = cast(Any, part)[key]
        if isinstance(inner, dict | list) and inner and draw(st.integers(0, 3)):
            part = cast(Any, inner)
            continue
        if draw(st.booleans()):
            part[key] = draw(json_values)
        else:
            del part[key]
        return value


@given(damaged())
@settings(max_examples=4 * settings().max_examples)
def test_damage_is_refused_or_harmless(value: Any) -> None:
    try:
        model = from_json(value)
    except PolicyFileError:
        return
    assert described(from_json(to_json(model))) == described(model)


@given(json_values)
def test_anything_else_is_refused(value: Any) -> None:
    with pytest.raises(PolicyFileError):
        from_json(value)
