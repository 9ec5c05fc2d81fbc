"""Which command or function accepts which kind of target, and why it refuses the others.

docs/targets.md shows the same table; a test holds the two together.
"""

from __future__ import annotations

from collections.abc import Collection

from ludus.errors import TargetError
from ludus.target.kinds import (
    Address,
    CargoPackage,
    Example,
    Executable,
    Gymnasium,
    Legacy,
    Play,
    PolicyFile,
    Run,
    Scene,
    Target,
)

__all__ = ["COMMANDS", "REFUSALS", "check_accepted"]

COMMANDS = (
    "make", "make_vec", "open_pool", "train", "evaluate", "play", "record", "check", "bench",
)  # fmt: skip
_OPENS_GAMES = ("make", "make_vec", "open_pool", "train", "check", "bench")

_NEEDS_A_GAME = (
    "{target} is a run, and {command} needs a game",
    "name the game that it was trained in; ludus train --resume goes on with a run",
)
_NEEDS_NO_POLICY = (
    "{target} is a policy file, and {command} needs a game",
    "ludus evaluate GAME --policy FILE lets it play, and ludus record GAME --policy FILE films it",
)
_NOT_OURS_TO_FILM = (
    "{target} is a game that somebody else starts, whose window cannot be filmed",
    "name a bundled example, a project folder or a scene, and a run with --policy",
)
_NO_CEILING = (
    "{target} has no engine whose ceiling could be measured",
    "name a game that Ludus opens itself",
)
_DRAWN_BY_ITSELF = (
    "{target} is a game of a legacy bridge, which {command} can neither pace nor measure",
    "train, evaluate, check and record take it; for {command}, move the game to the add-on: "
    "docs/godot_rl_agents.md, docs/gymgodot.md, docs/godot_gym_api.md, docs/bevy_rl.md",
)

Refusal = tuple[Collection[str], tuple[str, str]]
REFUSALS: dict[type[Target], tuple[Refusal, ...]] = {
    Example: (),
    Scene: (),
    Executable: (),
    CargoPackage: (),
    Address: ((("record",), _NOT_OURS_TO_FILM),),
    Play: ((("record",), _NOT_OURS_TO_FILM),),
    Gymnasium: ((("bench",), _NO_CEILING),),
    Legacy: ((("play", "bench"), _DRAWN_BY_ITSELF),),
    Run: ((_OPENS_GAMES, _NEEDS_A_GAME),),
    PolicyFile: ((COMMANDS, _NEEDS_NO_POLICY),),
}
"""By kind: commands that refuse it, and the error and hint that the user sees."""


def check_accepted(command: str, target: Target) -> None:
    """Refuse a target that a command cannot use.

    Args:
        command: One of :data:`COMMANDS`.
        target: What the user named.

    Raises:
        TargetError: The command refuses this kind; the text says why.
    """
    assert command in COMMANDS
    for commands, (message, hint) in REFUSALS[type(target)]:
        if command in commands:
            words = {"command": command, "target": target.name}
            raise TargetError(message.format(**words), hint.format(**words))
