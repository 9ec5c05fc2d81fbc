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

__all__ = ["COMMAND", "RENAMED_FLAGS", "ServeCommand", "run"]

MAX_LOG_BYTES = 1 << 20


@dataclass(frozen=True)
class ServeCommand:
    """Wait for games, and train them as they ask for it. Ctrl-C saves and stops.

    A game with our add-on and a LudusTraining node starts this command itself. A game that was
    written for godot-ai needs no change: --bridge godot-ai.

    Attributes:
        bridge: Legacy bridge that the games were written for: godot-ai; ludus is our add-on.
        port: TCP port, reachable from this machine only; none is 11011, or 9999 for godot-ai.
        runs: Folder of the runs; a game names its own in it. None is ./runs.
        policies: Folder that trained policies are written to for the game; none is the folder
            policies of the run.
        once: End when the first game has gone, or if none comes within a minute.
        project: godot-ai: folder of the game; none is this one. Files that it names are taken from
            there and from nowhere else; checkpoints are in its AIServerCommFiles/ludus.
        seed: Seed of new runs whose game names none; none draws one. godot-ai: seed of networks and
            sampling; none is 0.
        device: PyTorch device, such as cpu or cuda; auto is cuda where there is one.
        torch_threads: Threads PyTorch may use.
        message_timeout_s: Seconds within which a greeting, or with godot-ai the rest of a message,
            has to come.
        log: File that gets what happens, beside the terminal.
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
    """Serve; return 128 plus the signal that stopped it, or 0 if the one game has gone."""
    check(command)
    with _log_file(command.log):
        logging.getLogger("ludus.serve").setLevel(logging.INFO)
        from ludus.training.interrupt import Interrupts

        with Interrupts() as interrupts:
            _SERVERS[command.bridge](command, interrupts.is_stopping)
    return 0 if interrupts.signum is None else 128 + interrupts.signum


def check(command: ServeCommand) -> None:
    """Refuse options that do not fit.

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
    serve_guided(config, is_stopping, lambda port: _tell_ready(command, config.runs, port))


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
    serve(config, is_stopping, lambda port: _tell_ready(command, config.project, port))


_SERVERS: dict[str, Callable[[ServeCommand, IsStopping], None]] = {
    "ludus": _serve_guided,
    "godot-ai": _serve_godot_ai,
}
_NOT_OF = {"ludus": ("project",), "godot-ai": ("runs", "policies", "once")}
"""Options that a bridge does not have."""


def _tell_ready(command: ServeCommand, folder: Path, port: int) -> None:
    logging.getLogger("ludus.serve").debug("listening at 127.0.0.1:%d", port)
    sys.stderr.write(f"serving {command.bridge} games in {folder} at 127.0.0.1:{port}\n")
    sys.stderr.flush()


@contextmanager
def _log_file(path: Path | None) -> Generator[None, None, None]:
    """Write what ``ludus`` logs into a file as well, and the error that ends the command.

    The game that started the command shows the last line of it.
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


class _OneLine(logging.Formatter):
    """A line for every record, hints behind what they are about."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - logging's own name
        return super().formatMessage(record).replace("\n", "; ")
