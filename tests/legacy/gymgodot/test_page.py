"""What docs/gymgodot.md says of `ludus.make_vec` and pools works as it stands there."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Any

import pytest

from tests.legacy.gymgodot.conftest import ROOT, left_processes

pytestmark = pytest.mark.engine

PAGE = (ROOT / "docs/gymgodot.md").read_text()


def test_many_games_and_the_trainer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(Path(__file__).with_name("project"), tmp_path / "project")
    monkeypatch.chdir(tmp_path)
    section = PAGE.split("## Many games at once")[1].split("\n## ")[0]
    names: dict[str, Any] = {}
    scene = "path/to/gym-godot/examples/cartpole/Root.tscn"
    section = section.replace(scene, "project/cartpole.tscn").replace("10_000", "512")
    for code in re.findall(r"```python\n(.*?)```", section, re.DOTALL):
        exec(code, names)
    assert names["observations"].shape == (2, 4)
    assert names["rewards"].tolist() == [1.0, 1.0]
    assert len(list((tmp_path / "runs").iterdir())) == 1
    assert left_processes() == []
