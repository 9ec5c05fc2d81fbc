"""From the command line to a command, and from whatever happens there to an exit code.

A command is a module in this package with

- ``COMMAND``: a dataclass that tyro parses, its docstring the help;
- ``run(command) -> int``: does it and returns the exit code;
- optionally ``parse(arguments) -> COMMAND``, where one pass of tyro is not enough;
- optionally ``RENAMED_FLAGS``: flags of earlier versions, and what they are called now.

Modules load when their command is called, so that ``ludus --help`` is quick and needs no extra.
"""

from __future__ import annotations

import importlib
import logging
import os
import signal
import sys
import threading
import traceback
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from types import FrameType
from typing import Any, NoReturn

from ludus.errors import LudusError, UsageError, did_you_mean
from ludus.extras import EXTRAS, missing_extra
from ludus.printing import PrintableFormatter, printable
from ludus.version import __version__

__all__ = ["COMMANDS", "main", "parse"]

COMMANDS: dict[str, tuple[str, str]] = {
    "new": ("ludus.cli.new", "make a small project that trains at once"),
    "train": ("ludus.cli.train", "train agents in a game"),
    "sweep": ("ludus.cli.sweep", "look for better settings by many training runs"),
    "evaluate": ("ludus.cli.evaluate", "play episodes with trained agents and report the returns"),
    "play": ("ludus.cli.play", "watch trained agents in a window"),
    "record": ("ludus.cli.record", "film a game, as it is or played by trained agents"),
    "runs": ("ludus.cli.runs", "list training runs and how they went"),
    "control": ("ludus.cli.control", "switch modes of a running run, save or stop it"),
    "league": ("ludus.cli.league", "let the agents of a run and their past selves play each other"),
    "export": ("ludus.cli.export", "write trained agents as files for games and other runtimes"),
    "serve": ("ludus.cli.serve", "wait for games, and train them as they ask"),
    "bench": ("ludus.cli.bench", "measure how fast a game steps, and where the time goes"),
    "check": ("ludus.cli.check", "check that a game behaves as an environment"),
    "cluster": ("ludus.cli.cluster", "check the machines of a Ray cluster"),
    "engine": ("ludus.cli.engine", "install, list and examine game engines"),
    "addon": ("ludus.cli.addon", "copy the Ludus add-on into a game"),
}
"""Module and one line of help, by command."""

EXIT_OTHER, EXIT_USAGE, EXIT_INTERRUPTED, EXIT_TERMINATED, EXIT_PIPE = 1, 2, 130, 143, 141


def main(argv: Sequence[str] | None = None) -> int:
    """Run the ``ludus`` command and return its exit code.

    Args:
        argv: Arguments without the program's name; None takes the process's.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    is_debug = "--debug" in arguments
    is_trusting = "--trust" in arguments
    arguments = [argument for argument in arguments if argument not in {"--debug", "--trust"}]
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(PrintableFormatter("%(levelname)s %(name)s: %(message)s"))
    logging.basicConfig(level=logging.DEBUG if is_debug else logging.WARNING, handlers=[handler])
    try:
        with _clean_exit_on_sigterm(), _trusting_runs(is_trusting):
            return _dispatch(arguments)
    except KeyboardInterrupt:
        return _after("interrupted", "", EXIT_INTERRUPTED, is_debug)
    except BrokenPipeError:
        # What reads our output has gone; keep the interpreter from complaining at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_PIPE
    except SystemExit as error:  # tyro after --help or a wrong flag, and SIGTERM
        return error.code if isinstance(error.code, int) else int(error.code is not None)
    except Exception as error:
        return _report(error, is_debug)


def usage() -> str:
    """Return what ``ludus --help`` shows."""
    width = max(map(len, COMMANDS))
    lines = [f"  {name:<{width}}  {help_}" for name, (_, help_) in COMMANDS.items()]
    return "\n".join(
        [
            "usage: ludus COMMAND [...]",
            "",
            "Train agents in games made with Godot or Bevy, and put them back into the game.",
            "",
            "commands:",
            *lines,
            "",
            "options:",
            "  -h, --help  show this text; after a command, the help of that command",
            "  --version   show the version",
            "  --debug     show tracebacks and log messages",
            "  --trust     start the programs that a run names, though your ludus did not make it",
            "",
            "ludus COMMAND --help tells more about a command.",
            "",
        ]
    )


def _dispatch(arguments: list[str]) -> int:
    name = arguments[0] if arguments else "--help"
    if name in {"-h", "--help", "help"}:
        sys.stdout.write(usage())
        return 0 if arguments else EXIT_USAGE
    if name == "--version":
        sys.stdout.write(f"ludus {__version__}\n")
        return 0
    if name not in COMMANDS:
        hint = did_you_mean(name, COMMANDS, "commands")
        raise UsageError(f"there is no command {name}", hint)
    module: Any = importlib.import_module(COMMANDS[name][0])
    given = _with_current_flags(arguments[1:], getattr(module, "RENAMED_FLAGS", {}))
    return int(module.run(parse(module, name, given)))


def _with_current_flags(arguments: list[str], renamed: Mapping[str, str]) -> list[str]:
    """Replace flags of earlier versions, and name the new ones."""
    current: list[str] = []
    for argument in arguments:
        flag, *value = argument.split("=", 1)
        if flag in renamed:
            sys.stderr.write(f"{flag} is now called {renamed[flag]}\n")
            flag = renamed[flag]
        current.append("=".join((flag, *value)))
    return current


def parse(module: Any, name: str, arguments: list[str]) -> Any:
    """Return the command that a module makes of what was typed after its name."""
    if hasattr(module, "parse"):
        return module.parse(arguments)
    import tyro

    from ludus.cli.bridge_flags import take_bridge_flags

    takes_bridges = "bridge" in getattr(module.COMMAND, "__dataclass_fields__", {})
    rest, bridge = take_bridge_flags(arguments) if takes_bridges else (arguments, {})
    command: Any = tyro.cli(module.COMMAND, args=rest, prog=f"ludus {name}")
    return replace(command, bridge=bridge) if bridge else command


def _after(text: str, hint: str, exit_code: int, is_debug: bool) -> int:
    """Tell what happened on stderr; return the exit code."""
    if is_debug:
        traceback.print_exc()
    sys.stderr.write(f"{text}\n" + (f"hint: {hint}\n" if hint else ""))
    return exit_code


def _report(error: Exception, is_debug: bool) -> int:
    """Tell of an error, with a hint; return its exit code."""
    if isinstance(error, LudusError):
        return _after(f"error: {error.message}", error.hint, error.exit_code, is_debug)
    package = (getattr(error, "name", None) or "").partition(".")[0]
    if isinstance(error, ImportError) and package in EXTRAS:
        return _report(missing_extra(package), is_debug)
    text = printable(f"error: {type(error).__name__}: {error}")
    return _after(text, "this is a defect; --debug shows the traceback", EXIT_OTHER, is_debug)


@contextmanager
def _trusting_runs(is_trusting: bool) -> Generator[None, None, None]:
    if not is_trusting:
        yield
        return
    from ludus.runs.trust import IS_TRUSTING

    token = IS_TRUSTING.set(True)
    try:
        yield
    finally:
        IS_TRUSTING.reset(token)


@contextmanager
def _clean_exit_on_sigterm() -> Generator[None, None, None]:
    def leave(_: int, __: FrameType | None) -> NoReturn:
        raise SystemExit(EXIT_TERMINATED)

    if threading.current_thread() is not threading.main_thread():
        yield  # no signal arrives here
        return
    before = signal.signal(signal.SIGTERM, leave)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
