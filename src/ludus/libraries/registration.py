"""Make the bundled examples known to Gymnasium as ``ludus/CartPole-v0`` and so on.

GymGodot projects are ``ludus/GymGodot-v0``, or ``server-v0`` as in GymGodot's own package; games
for godot_gym_api are ``ludus/GodotGymApi-v0``.

``import ludus`` does it; Gymnasium 1 no longer looks for plug-ins by itself.
"""

from __future__ import annotations

from typing import Any, cast

import gymnasium

__all__ = ["ENVIRONMENT_IDS", "GYM_GODOT_IDS", "register_examples"]

ENVIRONMENT_IDS = {
    "ludus/CartPole-v0": "cartpole",
    "ludus/Pendulum-v0": "pendulum",
    "ludus/BallChase-v0": "ball_chase",
    "ludus/KeyDoor-v0": "key_door",
}
"""Gymnasium's id → bundled example. ``tag`` has two policies, which Gymnasium knows nothing of."""

GYM_GODOT_IDS = ("ludus/GymGodot-v0", "server-v0")
"""Our id and GymGodot's own, so that old programs find it."""


def register_examples() -> None:
    """Register the bundled examples, and the legacy bridges, with Gymnasium."""
    for environment_id, example in ENVIRONMENT_IDS.items():
        cast(Any, gymnasium).register(
            id=environment_id,
            entry_point="ludus.libraries:make",
            vector_entry_point="ludus.libraries:make_registered_vec",
            kwargs={"target": example},
        )
    for environment_id in GYM_GODOT_IDS:
        cast(Any, gymnasium).register(id=environment_id, entry_point="ludus.legacy.gymgodot:make")
    cast(Any, gymnasium).register(
        id="ludus/GodotGymApi-v0", entry_point="ludus.legacy.godot_gym_api:make"
    )
