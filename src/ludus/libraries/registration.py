"""Make the bundled examples known to Gymnasium as ``ludus/CartPole-v0`` and so on.

GymGodot projects are ``ludus/GymGodot-v0``, or ``server-v0`` as in GymGodot's own package; games
for godot_gym_api are ``ludus/GodotGymApi-v0``.

``import ludus`` does it; Gymnasium 1 no longer looks for plug-ins by itself. Gymnasium takes longer
to import than all that most commands need, so the ids are registered once something imports it.
"""

from __future__ import annotations

import importlib.abc
import importlib.util
import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any, cast

__all__ = ["ENVIRONMENT_IDS", "GYM_GODOT_IDS", "register_examples"]

ENVIRONMENT_IDS = {
    "ludus/CartPole-v0": "cartpole",
    "ludus/Pendulum-v0": "pendulum",
    "ludus/BallChase-v0": "ball_chase",
    "ludus/AppleSeeker-v0": "apple_seeker",
    "ludus/KeyDoor-v0": "key_door",
    "ludus/FindCoin-v0": "find_coin",
    "ludus/Tag-v0": "tag",
    "ludus/Zombies-v0": "zombies",
}
"""Gymnasium's id → bundled example. The last three have two policies: ``policy=…`` chooses one."""

AGENTS_PER_WORLD = {"ball_chase": 16}
"""Of examples with several agents, so that these need not be started to be asked."""

GYM_GODOT_IDS = ("ludus/GymGodot-v0", "server-v0")
"""Our id and GymGodot's own, so that old programs find it."""


def register_examples() -> None:
    """Register the bundled examples, and the legacy bridges, as soon as Gymnasium is imported."""
    if "gymnasium" in sys.modules:
        _register()
    else:
        sys.meta_path.insert(0, _GymnasiumFinder())


class _GymnasiumFinder(importlib.abc.MetaPathFinder):
    """Finds Gymnasium where it is, and has the environments registered after its import."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname != "gymnasium":
            return None
        sys.meta_path.remove(self)
        try:
            spec = importlib.util.find_spec(fullname)
        finally:
            # Who finds need not import: TorchRL only asks whether there is a Gymnasium.
            sys.meta_path.insert(0, self)
        if spec is not None and spec.loader is not None:
            load = spec.loader.exec_module

            def load_and_register(module: ModuleType) -> None:
                load(module)
                sys.meta_path.remove(self)
                _register()

            spec.loader.exec_module = load_and_register
        return spec


def _register() -> None:
    import gymnasium

    for environment_id, example in ENVIRONMENT_IDS.items():
        cast(Any, gymnasium).register(
            id=environment_id,
            entry_point="ludus.libraries:make",
            vector_entry_point="ludus.libraries:make_registered_vec",
            kwargs={"target": example},
        )
    for environment_id in GYM_GODOT_IDS:
        # Gymnasium's own checks expect five values of `step`; ours keep the order of calls.
        cast(Any, gymnasium).register(
            id=environment_id,
            entry_point="ludus.legacy.gymgodot:make",
            order_enforce=False,
            disable_env_checker=True,
        )
    cast(Any, gymnasium).register(
        id="ludus/GodotGymApi-v0", entry_point="ludus.legacy.godot_gym_api:make"
    )
