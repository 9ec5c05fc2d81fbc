"""Find Godot RL Agents in a project, and the script of it that ours takes the place of."""

from __future__ import annotations

import re
from pathlib import Path

from ludus.addon import GDRL_PATH

__all__ = ["forwarding_scripts"]

_SYNC = "addons/godot_rl_agents/sync.gd"
"""Of all its scripts this one talks to a trainer; scenes name this path."""
_CLASS_NAME = "class_name Sync\n"
_FORWARDING_SCRIPT = f"""\
extends "res://{GDRL_PATH}/sync.gd"
# In the place of a script of Godot RL Agents, for scenes and scripts that name its path.
# Made by `ludus addon install --legacy`, which keeps that script in {{kept}}.
"""


def forwarding_scripts(root: Path) -> dict[Path, str]:
    """Return what takes the place of its script in a project; empty where there is none.

    ``{kept}`` in it is the folder of the backup. Controllers and sensors speak no protocol and
    stay the game's own.
    """
    file = root / _SYNC
    if not file.is_file():
        return {}
    text = file.read_text(encoding="utf-8", errors="replace")
    has_name = re.search(r"^class_name Sync\b", text, re.MULTILINE)
    return {file: (_CLASS_NAME if has_name else "") + _FORWARDING_SCRIPT}
