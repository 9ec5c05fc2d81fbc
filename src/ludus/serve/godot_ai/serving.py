"""Put a server together: files, agents, commands, sockets."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import torch

from ludus.errors import RunError, TargetError
from ludus.locks import LockHeld, file_lock
from ludus.networks.device import choose_device
from ludus.serve.godot_ai.agents import Agents
from ludus.serve.godot_ai.commands import GodotAi
from ludus.serve.godot_ai.project_files import ProjectFiles
from ludus.serve.godot_ai.server import Server, ServerConfig

__all__ = ["ServeConfig", "serve"]

LOCK_TIMEOUT_S = 0.0

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class ServeConfig:
    """What to serve.

    Attributes:
        project: Folder that the game runs in.
        port: TCP port on the loopback address; 0 takes a free one.
        seed: Of networks and sampling.
        device: PyTorch device, or ``auto``.
        torch_threads: Threads PyTorch may use.
        message_timeout_s: How long a client may take for the rest of a message.
    """

    project: Path
    port: int = 9999
    seed: int = 0
    device: str = "auto"
    torch_threads: int = 1
    message_timeout_s: float = 10.0


def serve(
    config: ServeConfig, is_stopping: Callable[[], bool], on_ready: Callable[[int], None]
) -> None:
    """Serve games until ``is_stopping``.

    Args:
        config: What to serve.
        is_stopping: Asked often, from several threads.
        on_ready: Called with the port, once clients can connect.

    Raises:
        TargetError: There is no such folder.
        SetupError: The port is taken.
        RunError: Another server serves this project, or checkpoints cannot be written.
    """
    if not config.project.is_dir():
        raise TargetError(
            f"there is no folder {config.project}", "--project names the folder of the game"
        )
    if not (config.project / "project.godot").is_file():
        log.warning("%s has no project.godot; is it the folder of the game?", config.project)
    device = choose_device(config.device)
    torch.set_num_threads(config.torch_threads)
    files = ProjectFiles(config.project)
    agents = Agents(files, config.seed, device)
    try:
        with file_lock(agents.lock, LOCK_TIMEOUT_S):
            server = Server(ServerConfig(config.port, config.message_timeout_s))
            on_ready(server.port)
            server.run(GodotAi(files, agents, is_stopping), is_stopping)
    except LockHeld:
        raise RunError(
            f"another ludus serve serves {config.project}", "end that one, or use it"
        ) from None
