"""F1 in the editor and docs/godot.md say what each property of the add-on is for."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from ludus.addon import ADDON_PATH
from ludus.engine import EngineKind
from ludus.engine.bundled import bundled_root


def test_every_exported_property_is_described() -> None:
    num_found = 0
    for path in (bundled_root(EngineKind.GODOT4) / ADDON_PATH).rglob("*.gd"):
        lines = path.read_text().splitlines()
        for i, line in enumerate(lines):
            if re.match(r"@export(?!_group|_category|_subgroup|_storage)", line):
                num_found += 1
                assert lines[i - 1].startswith("##"), f"{path.name}:{i + 1}: {line}"
    assert num_found > 60


@pytest.mark.parametrize(
    ("name", "script"),
    [
        ("LudusAgent", "ludus_agent.gd"),
        ("LudusActionComponent", "ludus_action_component.gd"),
        ("LudusObservationEntry", "ludus_observation_entry.gd"),
    ],
)
def test_the_page_lists_every_property_with_its_default(name: str, script: str) -> None:
    page = (Path(__file__).parents[2] / "docs/godot.md").read_text()
    table = page.split(f"| {name} | default | |\n|---|---|---|\n")[1].split("\n\n")[0]
    listed: dict[str, str] = {}
    for row in table.splitlines():
        names, defaults = (re.findall(r"`([^`]+)`", cell) for cell in row.split("|")[1:3])
        listed |= dict(zip(names, defaults or [""], strict=True))
    code = (bundled_root(EngineKind.GODOT4) / ADDON_PATH / "agent" / script).read_text()
    exported = re.findall(r"^@export.* var (\w+): [^=\n]+?(?: = (.+?))?:?$", code, re.MULTILINE)
    assert listed == {
        name: default.rpartition(".")[2] if default[:1].isalpha() else default
        for name, default in exported
    }
