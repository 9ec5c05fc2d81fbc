"""Scripts of the names, places and classes of godot_gym_api's; nothing of its code."""

from __future__ import annotations

from pathlib import Path

from ludus.engine.script_classes import ScriptClass, add_script_classes

__all__ = ["FOLDER", "ORIGINALS", "add_originals"]

FOLDER = "addons/reinforcement_learning"
ORIGINALS = {
    "Communication": ("rl_environment/communication.gd", "Object"),
    "PhysicsFramesTimer": ("rl_environment/physics_frames_timer.gd", "Object"),
    "RLAgent": ("rl_agent.gd", "Spatial"),
    "RLEnvWorld": ("rl_env_world.gd", "Spatial"),
    "RLEnvironment": ("rl_environment/rl_environment.gd", "Spatial"),
}
"""Class → script and base."""


def add_originals(project: Path) -> None:
    """Write the scripts, and list their classes as the editor does."""
    scripts: list[ScriptClass] = []
    for name, (path, base) in ORIGINALS.items():
        file = project / FOLDER / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(f'extends {base}\nclass_name {name}, "icon.png"\n')
        icon = f"res://{FOLDER}/icon.png"
        scripts.append(ScriptClass(name, base, f"res://{FOLDER}/{path}", icon))
    project_file = project / "project.godot"
    project_file.write_text(add_script_classes(project_file.read_text(), scripts))
