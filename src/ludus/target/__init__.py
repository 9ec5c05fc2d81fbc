"""What a user names to train, play, film or measure, and which command accepts it."""

from ludus.target.acceptance import COMMANDS, REFUSALS, check_accepted
from ludus.target.kinds import (
    Address,
    CargoPackage,
    EngineTarget,
    Example,
    Executable,
    Game,
    Gymnasium,
    Legacy,
    Play,
    PolicyFile,
    Run,
    Scene,
    Target,
    prepare,
)
from ludus.target.parsing import (
    GYMNASIUM_PREFIX,
    LEGACY_PREFIXES,
    find_run,
    parse_target,
    split_addresses,
)

__all__ = [
    "COMMANDS",
    "GYMNASIUM_PREFIX",
    "LEGACY_PREFIXES",
    "REFUSALS",
    "Address",
    "CargoPackage",
    "EngineTarget",
    "Example",
    "Executable",
    "Game",
    "Gymnasium",
    "Legacy",
    "Play",
    "PolicyFile",
    "Run",
    "Scene",
    "Target",
    "check_accepted",
    "find_run",
    "parse_target",
    "prepare",
    "split_addresses",
]
