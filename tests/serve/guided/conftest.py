"""A server of guided games in this process, and games that come to it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import torch

from ludus.runs.checkpoint import Checkpoint, read_checkpoint
from ludus.runs.run_folder import RunFolder
from ludus.serve.guided.serving import GuidedConfig, serve_guided
from tests.serve.guided.game import DEADLINE_S, Game


class Running:
    """A server that runs in a thread, and the games that came to it."""

    def __init__(self, config: GuidedConfig) -> None:
        self.config = config
        self.port = 0
        self.error: BaseException | None = None
        self._is_stopping = threading.Event()
        self._is_ready = threading.Event()
        self._games: list[Game] = []
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()
        assert self._is_ready.wait(DEADLINE_S)

    def _serve(self) -> None:
        def on_ready(port: int) -> None:
            self.port = port
            self._is_ready.set()

        try:
            serve_guided(self.config, self._is_stopping.is_set, on_ready)
        except BaseException as error:
            self.error = error
        self._is_ready.set()

    def game(self, run: str | None = "run", **changes: Any) -> Game:
        """Let a game come; it guides, unless ``training`` says otherwise."""
        if run is not None:
            changes = {"training": {"run": run, "num_worlds": 3}, **changes}
        self._games.append(Game(self.port, **changes))
        return self._games[-1]

    def training(self, **changes: Any) -> Game:
        """Let a game come that is being trained."""
        game = self.game(**changes)
        game.ask("start")
        game.await_updates(2)
        return game

    def folder(self, run: str = "run") -> RunFolder:
        return RunFolder(self.config.runs / run)

    def newest(self, run: str = "run") -> Checkpoint:
        return read_checkpoint(self.folder(run).checkpoints().paths()[-1], has_replay=True)

    def stop(self) -> None:
        self._is_stopping.set()
        self.wait()

    def wait(self) -> None:
        """Wait until the server has ended by itself."""
        self._thread.join(DEADLINE_S)
        assert not self._thread.is_alive(), "the server does not end"

    def end(self) -> None:
        self.stop()
        for game in self._games:
            game.await_the_end()


Start = Callable[..., Running]


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Start]:
    """Starts servers, and ends them; those that ended with an error must be asked for it."""
    num_threads = torch.get_num_threads()
    started: list[Running] = []

    def begin(**changes: Any) -> Running:
        values: dict[str, Any] = {"port": 0, "runs": tmp_path / "runs", "seed": 3}
        started.append(Running(GuidedConfig(**{**values, **changes})))
        return started[-1]

    yield begin
    for running in started:
        running.end()
    torch.set_num_threads(num_threads)
    assert [running.error for running in started if running.error] == []


@pytest.fixture
def server(start: Start) -> Running:
    return start()
