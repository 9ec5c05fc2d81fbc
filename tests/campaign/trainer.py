"""A trainer of the campaign: ``ludus train`` in a fork of the campaign.

A fork has PyTorch already and starts in milliseconds, where a new process takes seconds.
"""

from __future__ import annotations

import dataclasses
import faulthandler
import logging
import os
import sys
import tempfile
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from ludus.cli import main, train
from ludus.pool import PoolConfig, open_pool
from ludus.runs.run_folder import RunFolder, stack_layers
from ludus.settings.merging import Layer
from ludus.training import loop
from tests.campaign.processes import MARK

if TYPE_CHECKING:
    from tests.campaign.rounds import Round

__all__ = ["STEP_TIMEOUT_S", "be_trainer", "preload"]

STEP_TIMEOUT_S = 4.0
START_TIMEOUT_S = 60.0
STACKS_AFTER_S = 150.0


def preload() -> None:
    """Load what every trainer needs, in one thread, so that forks are quick and safe."""
    import PIL.Image
    import torch
    from matplotlib.backends import backend_agg
    from matplotlib.figure import Figure

    torch.set_num_threads(1)  # the forks of a process with more are not safe, and slower
    PIL.Image.init()
    backend_agg.FigureCanvasAgg(Figure())
    logging.getLogger("ludus").addHandler(logging.NullHandler())  # of what the checks read


def be_trainer(
    the_round: Round,
    settings: Mapping[str, Any],
    resume: Path | None,
    output: Path,
    before: Callable[[], None] | None,
) -> NoReturn:
    """Train as ``ludus train`` does, in a fork; never returns."""
    code = 70
    try:
        _move_in(the_round, output)
        setattr(train, "parse", _make_parser(settings, resume))  # noqa: B010
        if before is not None:
            before()
        code = main(["train"])
        sys.stdout.flush()
        sys.stderr.flush()
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(code)


def _make_parser(
    settings: Mapping[str, Any], resume: Path | None
) -> Callable[[list[str]], train.TrainCommand]:
    """Return what takes the place of parsing a command line, which takes a second."""

    def parse(_: list[str]) -> train.TrainCommand:
        folder = None if resume is None else RunFolder.find(resume)
        layers = stack_layers(Layer("command line", settings), run=folder)
        return train.TrainCommand(resume=None if folder is None else folder.path, layers=layers)

    return parse


def _move_in(the_round: Round, output: Path) -> None:
    """Make the round's folder the whole world of this process."""
    os.setsid()
    os.chdir(the_round.folder)
    file = os.open(output, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    os.dup2(file, 1)
    os.dup2(file, 2)
    sys.stdout = open(1, "w", closefd=False)  # noqa: SIM115 - for as long as it lives
    sys.stderr = open(2, "w", closefd=False)  # noqa: SIM115
    faulthandler.dump_traceback_later(STACKS_AFTER_S, file=sys.stderr)
    os.environ[MARK] = str(the_round.folder)
    os.environ["TMPDIR"] = str(the_round.temporary)
    tempfile.tempdir = None
    loop.open_pool = _open_impatiently
    logger = logging.getLogger("ludus.training.trainer")
    logger.setLevel(logging.DEBUG)
    logger.propagate = False  # what is said to users stays as it is
    logger.addHandler(_SavedList(the_round.saved_list))


def _open_impatiently(target: Any, config: PoolConfig) -> Any:
    launch = dataclasses.replace(
        config.launch, step_timeout_s=STEP_TIMEOUT_S, start_timeout_s=START_TIMEOUT_S
    )
    return open_pool(target, dataclasses.replace(config, launch=launch, is_pinned=False))


class _SavedList(logging.Handler):
    """Notes each checkpoint when the trainer reports that it is saved, before anything else."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)

    def emit(self, record: logging.LogRecord) -> None:
        if record.msg == "saved %s":
            path = record.getMessage().removeprefix("saved ")
            os.write(self._file, f"{path}\n".encode(errors="surrogateescape"))
