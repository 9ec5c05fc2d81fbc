"""``ludus serve``: wait for games, and train them."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass
from logging.handlers import RotatingFileHandler
from pathlib import Path

from ludus.disk import disk_errors
from ludus.errors import UsageError
from ludus.printing import PrintableFormatter

__all__ = ["COMMAND", "RENAMED_FLAGS", "ServeCommand", "run"]

MAX_LOG_BYTES = 1 << 20


@dataclass(frozen=True)
class ServeCommand:
    """Wait for games, and train each as it asks. Ctrl-C saves and stops.

    A game with the Ludus add-on and a LudusTraining node starts this command itself. A game written
    for godot-ai works unchanged with --bridge godot-ai.

    Attributes:
        bridge: Protocol of the games: ludus (the Ludus add-on), or godot-ai (a legacy bridge).
        port: TCP port, open to this machine only; if not given, 11011, or 9999 for godot-ai.
        runs: Folder of the runs; each game names its own run. ./runs if not given.
        policies: Folder for the policies that games ask for; if not given, the folder policies of
            the run.
        once: End when the first game has disconnected, or if none connects within a minute.
        project: For godot-ai: folder of the game, the current one if not given. Files that the game
            names are read from there only; checkpoints are in its AIServerCommFiles/ludus.
        seed: Seed of new runs for which the game gives none; random if not given. For godot-ai:
            seed of networks and sampling, 0 if not given.
        device: PyTorch device, such as cpu or cuda; auto is cuda if it is available.
        torch_threads: Threads that PyTorch may use.
        message_timeout_s: Seconds that a game may take to introduce itself; with godot-ai, to
            complete a message.
        log: File for log messages, in addition to the terminal.
    """

    bridge: str = "ludus"
    port: int | None = None
    runs: Path | None = None
    policies: Path | None = None
    once: bool = False
    project: Path | None = None
    seed: int | None = None
    device: str = "auto"
    torch_threads: int = 1
    message_timeout_s: float = 10.0
    log: Path | None = None


COMMAND = ServeCommand
RENAMED_FLAGS = {"--dialect": "--bridge"}

IsStopping = Callable[[], bool]


def run(command: ServeCommand) -> int:
    """Serve; return 128 plus the signal that stopped it, or 0 after the one game of --once."""
    check(command)
    with _log_file(command.log):
        logging.getLogger("ludus.serve").setLevel(logging.INFO)
        from ludus.training.interrupt import Interrupts

        with Interrupts() as interrupts:
            _SERVERS[command.bridge](command, interrupts.is_stopping)
    return 0 if interrupts.signum is None else 128 + interrupts.signum


def check(command: ServeCommand) -> None:
    """Refuse options that the bridge does not have, or that are out of range.

    Raises:
        UsageError: There is no such bridge, or it has no such option.
    """
    if command.bridge not in _SERVERS:
        known = " or ".join(f"--bridge {bridge}" for bridge in _SERVERS)
        raise UsageError(f"there is no bridge {command.bridge!r} to serve", f"write {known}")
    default = ServeCommand()
    for name in _NOT_OF[command.bridge]:
        if getattr(command, name) != getattr(default, name):
            others = " and ".join(one for one, names in _NOT_OF.items() if name not in names)
            raise UsageError(
                f"--{name} is not an option of --bridge {command.bridge}",
                f"it is an option of --bridge {others}",
            )
    if command.message_timeout_s <= 0 or command.torch_threads < 1:
        raise UsageError("--message-timeout-s must be above 0, and --torch-threads at least 1")


def _serve_guided(command: ServeCommand, is_stopping: IsStopping) -> None:
    from ludus.serve.guided.serving import GuidedConfig, serve_guided

    config = GuidedConfig(
        port=GuidedConfig.port if command.port is None else command.port,
        runs=command.runs or GuidedConfig.runs,
        policies=command.policies,
        is_once=command.once,
        seed=command.seed,
        device=command.device,
        torch_threads=command.torch_threads,
        hello_timeout_s=command.message_timeout_s,
    )
    serve_guided(config, is_stopping, lambda port: _print_ready(command, config.runs, port))


def _serve_godot_ai(command: ServeCommand, is_stopping: IsStopping) -> None:
    from ludus.serve.godot_ai.serving import ServeConfig, serve

    config = ServeConfig(
        project=command.project or Path(),
        port=ServeConfig.port if command.port is None else command.port,
        seed=command.seed or 0,
        device=command.device,
        torch_threads=command.torch_threads,
        message_timeout_s=command.message_timeout_s,
    )
    serve(config, is_stopping, lambda port: _print_ready(command, config.project, port))


_SERVERS: dict[str, Callable[[ServeCommand, IsStopping], None]] = {
    "ludus": _serve_guided,
    "godot-ai": _serve_godot_ai,
}
_NOT_OF = {"ludus": ("project",), "godot-ai": ("runs", "policies", "once")}
"""Options that a bridge does not have."""


def _print_ready(command: ServeCommand, folder: Path, port: int) -> None:
    logging.getLogger("ludus.serve").debug("listening at 127.0.0.1:%d", port)
    sys.stderr.write(f"serving {command.bridge} games in {folder} at 127.0.0.1:{port}\n")
    sys.stderr.flush()


@contextmanager
def _log_file(path: Path | None) -> Generator[None, None, None]:
    """Also write log messages, and the error that ends the command, to a file.

    The game that started the command shows the file's last line.
    """
    if path is None:
        yield
        return
    with disk_errors(f"the log {path}"):
        path.parent.mkdir(parents=True, exist_ok=True)
        handler = RotatingFileHandler(path, maxBytes=MAX_LOG_BYTES, backupCount=1, encoding="utf-8")
    handler.setFormatter(_OneLine("%(asctime)s %(levelname)s %(name)s: %(message)s"))
    logger = logging.getLogger("ludus")
    logger.addHandler(handler)
    try:
        yield
    except Exception as error:
        record = logger.makeRecord("ludus.serve", logging.ERROR, "", 0, str(error), (), None)
        handler.handle(record)
        raise
    finally:
        logger.removeHandler(handler)
        handler.close()


class _OneLine(PrintableFormatter):
    """Formats every record as one line, with hints appended."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - logging's own name
        return super().formatMessage(record).replace("\n", "; ")
