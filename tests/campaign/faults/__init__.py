"""The kinds of fault. Each is a function that plays one round; its module holds nothing else."""

from __future__ import annotations

from collections.abc import Callable

from tests.campaign.faults.damage import damage_files
from tests.campaign.faults.engine_frames import fuzz_godot
from tests.campaign.faults.frames import fuzz_frames
from tests.campaign.faults.full_disk import fill_disk
from tests.campaign.faults.kill import kill_engine, kill_trainer, kill_trainer_of_game
from tests.campaign.faults.lies import lie_on_the_wire
from tests.campaign.faults.names import name_folders, name_policies
from tests.campaign.faults.nodes import harm_nodes
from tests.campaign.faults.stop import stop_engine, stop_trainer
from tests.campaign.faults.strangers import start_among_strangers
from tests.campaign.faults.workers import harm_workers
from tests.campaign.rounds import Round

__all__ = ["FAULTS"]

FAULTS: dict[str, tuple[int, Callable[[Round], None]]] = {
    "kill": (12, kill_trainer),
    "kill-with-game": (3, kill_trainer_of_game),
    "kill-engine": (3, kill_engine),
    "stop": (2, stop_trainer),
    "stop-engine": (2, stop_engine),
    "damage": (10, damage_files),
    "full-disk": (4, fill_disk),
    "lies": (6, lie_on_the_wire),
    "folders": (2, name_folders),
    "policies": (2, name_policies),
    "workers": (2, harm_workers),
    "nodes": (1, harm_nodes),
    "strangers": (1, start_among_strangers),
    "frames": (6, fuzz_frames),
    "godot-frames": (1, fuzz_godot),
}
"""How often a fault is drawn, and what plays it."""
