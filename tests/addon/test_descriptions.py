"""F1 in the editor says what each property of the add-on is for."""

from __future__ import annotations

import re

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
