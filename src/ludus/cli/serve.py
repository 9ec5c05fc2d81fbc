"""``ludus serve``: be the Python side of a game that brings its own protocol."""

from __future__ import annotations

import logging
import sys
from dataclasses import dataclass
from pathlib import Path

__all__ = ["COMMAND", "ServeCommand", "run"]


@dataclass(frozen=True)
class ServeCommand:
    """Act and learn for a game that was written for another trainer, and needs no change.

    The game connects to this server as it does to its own. Ctrl-C saves and stops.

    Attributes:
        dialect: What the game speaks: godot-ai.
        project: Folder of the game. Files that it names are taken from there and from nowhere
            else; checkpoints are in its AIServerCommFiles/ludus.
        port: TCP port, reachable from this machine only.
        seed: Seed of networks and sampling.
        device: PyTorch device, such as cpu or cuda; auto is cuda where there is one.
        torch_threads: Threads PyTorch may use.
        message_timeout_s: Seconds after which half a message ends a connection.
    """

    dialect: str | None = None
    project: Path = Path()
    port: int = 9999
    seed: int = 0
    device: str = "auto"
    torch_threads: int = 1
    message_timeout_s: float = 10.0


COMMAND = ServeCommand


def run(command: ServeCommand) -> int:
    """Serve; return 128 plus the signal that stopped it."""
    from ludus.serve.serving import ServeConfig, check_dialect, serve
    from ludus.train.interrupt import Interrupts

    check_dialect(command.dialect)
    logging.getLogger("ludus.serve").setLevel(logging.INFO)

    def on_ready(port: int) -> None:
        where = f"127.0.0.1:{port}"
        sys.stderr.write(f"serving {command.dialect} games in {command.project} at {where}\n")
        sys.stderr.flush()

    config = ServeConfig(
        dialect=command.dialect,
        project=command.project,
        port=command.port,
        seed=command.seed,
        device=command.device,
        torch_threads=command.torch_threads,
        message_timeout_s=command.message_timeout_s,
    )
    with Interrupts() as interrupts:
        serve(config, interrupts.is_stopping, on_ready)
    return 128 + (interrupts.signum or 0)
