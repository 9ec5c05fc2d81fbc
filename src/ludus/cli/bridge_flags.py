"""Settings of a legacy bridge on the command line: ``--action-space "Discrete(2)"`` and so on.

Which there are depends on the target, so they are taken out of the arguments before tyro sees them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import tyro

__all__ = ["BridgeFlags", "take_bridge_flags"]


@dataclass(frozen=True, kw_only=True)
class BridgeFlags:
    """What :func:`take_bridge_flags` has found; no flag itself."""

    bridge: tyro.conf.Suppress[Mapping[str, Any]] = field(default_factory=dict[str, Any])


def take_bridge_flags(arguments: Sequence[str]) -> tuple[list[str], dict[str, Any]]:
    """Split what was typed into what tyro knows and the settings of the target's bridge.

    A game of a bridge is one world, and one game unless more are asked for: the rest says so.

    Args:
        arguments: What was typed after the command.

    Returns:
        The rest, and the settings by name: texts, or True for a flag without a value. Both are as
        they were where no argument names a game of a legacy bridge.
    """
    from ludus.target import LEGACY_PREFIXES

    values = [word.partition("=")[2] if word.startswith("--") else word for word in arguments]
    target = next((word for word in values if word.startswith(tuple(LEGACY_PREFIXES))), None)
    if target is None:
        return list(arguments), {}
    from ludus.legacy.registry import find_bridge

    bridge = find_bridge(target)
    assert bridge is not None, "a test holds the prefixes of targets and bridges together"
    flags = {f"--{name}": name for name in bridge.setting_names}
    flags |= {flag.replace("_", "-"): name for flag, name in flags.items()}
    rest: list[str] = []
    found: dict[str, Any] = {}
    words = list(arguments)
    while words:
        word = words.pop(0)
        flag, equals, value = word.partition("=")
        if flag not in flags:
            rest.append(word)
        elif equals:
            found[flags[flag]] = value
        elif words and not words[0].startswith("--") and not bridge.is_switch(flags[flag]):
            found[flags[flag]] = words.pop(0)
        else:
            found[flags[flag]] = True
    typed = {word.partition("=")[0].replace("_", "-") for word in rest}
    for flag in ("--num-worlds", "--num-engines"):
        if flag not in typed:
            rest += [flag, "1"]
    return rest, found
