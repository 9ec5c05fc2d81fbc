"""docs/python.md: its examples are short and learn, on a real Godot, in shorter runs."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

import ludus

PAGE = Path(__file__).parents[2] / "docs" / "python.md"
BLOCKS = re.findall(r"(<!-- example: [\w ]+ -->\n)?```python\n(.*?)```", PAGE.read_text(), re.S)
EXAMPLES = {name.split(": ")[1].removesuffix(" -->\n"): code for name, code in BLOCKS if name}
SHORT: dict[str, Any] = {
    "total_steps": 16_384, "num_worlds": 16, "num_engines": 1, "evaluation_episodes": 2,
}  # fmt: skip


@pytest.fixture
def short_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    train: Any = ludus.train

    def train_shortly(*given: Any, **named: Any) -> Any:
        return train(*given, **{**named, **SHORT})

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(ludus, "train", train_shortly, raising=False)


@pytest.mark.engine
@pytest.mark.usefixtures("short_runs")
@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_is_short_and_learns(name: str) -> None:
    code = EXAMPLES[name]
    assert code.count("\n") < 100
    names: dict[str, Any] = {"__name__": "example"}
    exec(compile(code, "docs/python.md", "exec"), names)
    lines = [line["policies"]["cart"] for line in names["run"].metrics]
    assert lines[-1]["mean_return"] > lines[0].get("mean_return", 0.0)
