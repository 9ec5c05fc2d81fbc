"""docs/python.md: its examples are short and learn, on a real Godot, in shorter runs."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "python.md"
BLOCKS = re.findall(r"(<!-- example: [\w ]+ -->\n)?```python\n(.*?)```", PAGE.read_text(), re.S)
EXAMPLES = {name.split(": ")[1].removesuffix(" -->\n"): code for name, code in BLOCKS if name}


@pytest.mark.engine
@pytest.mark.games
@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_is_short_and_learns(name: str, shorten_training: Callable[[int], None]) -> None:
    shorten_training(16_384)
    code = EXAMPLES[name]
    assert code.count("\n") < 100
    names: dict[str, Any] = {"__name__": "example"}
    exec(compile(code, "docs/python.md", "exec"), names)
    lines = [line["policies"]["cart"] for line in names["run"].metrics]
    assert lines[-1]["mean_return"] > lines[0].get("mean_return", 0.0)
