"""Only what users place, extend or name is a global class of their project."""

from __future__ import annotations

import re

from ludus.addon import ADDON_PATH
from ludus.engine import EngineKind
from ludus.engine.bundled import bundled_root

PUBLIC = {
    "LudusActionComponent",
    "LudusAgent",
    "LudusBridge",
    "LudusCamera2D",
    "LudusCamera3D",
    "LudusController2D",
    "LudusController3D",
    "LudusDebugView",
    "LudusGrid2D",
    "LudusGrid3D",
    "LudusNearest2D",
    "LudusNearest3D",
    "LudusObservationEntry",
    "LudusPace",
    "LudusPolicy",
    "LudusPolicyPlayer",
    "LudusPolicySettings",
    "LudusRays2D",
    "LudusRays3D",
    "LudusRelative2D",
    "LudusRelative3D",
    "LudusSensor2D",
    "LudusSensor3D",
    "LudusSimulation",
    "LudusSimulationHost",
    "LudusTraining",
    "LudusWorld",
}
FILES = {"LudusBridge": "ludus_bridge_names"}
"""Where a class is not in the file of its name: that is the autoload's."""


def test_global_classes_are_the_public_ones() -> None:
    found: dict[str, str] = {}
    for path in (bundled_root(EngineKind.GODOT4) / ADDON_PATH).rglob("*.gd"):
        for name in re.findall(r"^class_name (\w+)", path.read_text(), flags=re.MULTILINE):
            found[name] = path.stem
    assert set(found) == PUBLIC
    for name, stem in found.items():
        expected = FILES.get(name, name.lower()).replace("_", "")
        assert stem.replace("_", "") == expected, "the file of a public class is named after it"
