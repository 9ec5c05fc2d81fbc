"""What simulations made in the physics servers is freed, or the game says that it is not."""

from __future__ import annotations

import re
import struct
from pathlib import Path

import pytest

from ludus.engine import (
    EngineProcess,
    GodotFlags,
    InstalledEngine,
    LaunchConfig,
    ensure_imported,
    godot_command,
    read_project,
)
from ludus.engine.project import RUN_SCENE
from ludus.link import Link, Listener
from ludus.wire.frames import FrameType
from tests.godot.simulation_games import write_project
from tests.raw_trainer import TOKEN_ENV, greet
from tests.wire.golden import load
from tests.wire.reference import frame, json_frame

pytestmark = pytest.mark.engine
RESET = frame("RESET", struct.pack("<II", 2, 4) + bytes(16) + bytes([2, 2]) + bytes(6) + b"null")
STEP_BYTES = {"fall": 16}
ROUNDS_STEP_BYTES = 48
ALARM = re.compile(r"leak|error|warning|orphan|still in use|behind", re.IGNORECASE)
WARNING = (
    "WARNING: ludus: res://leaky.gd leaves 1 2D body, 1 2D area, 3 2D shapes, 1 3D body, "
    "1 3D shape behind"
)


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("leaks")
    write_project(folder)
    return folder


def play(link: Link, name: str, layout: str) -> None:
    """Train two worlds that are made twice, and say goodbye."""
    greet(link)
    config = {"scene": f"res://{name}.tscn", "num_worlds": 2, "layout": layout}
    link.send(json_frame("WELCOME", {**load("welcome").content, "config": config}))
    assert link.receive()[0] is FrameType.SPEC
    for _ in range(2):
        link.send(RESET)
        assert link.receive()[0] is (FrameType.ERROR if name == "endless" else FrameType.BATCH)
        if name == "endless":
            return
        for _ in range(6):
            link.send(frame("STEP", bytes(STEP_BYTES.get(name, ROUNDS_STEP_BYTES))))
            assert link.receive()[0] is FrameType.BATCH
    link.send(frame("CLOSE", b""))


def last_words(
    engine: InstalledEngine, folder: Path, log: Path, name: str, layout: str
) -> list[str]:
    """Return the alarming lines of a verbose engine that has played and ended by itself."""
    project = read_project(folder)
    ensure_imported(engine, project)
    listener = Listener()
    flags = GodotFlags(user_args=(f"--ludus-connect={','.join(listener.addresses)}",))
    program, *rest = godot_command(engine, project.root, RUN_SCENE, flags)
    command = (program, "--verbose", *rest)
    with EngineProcess.start(LaunchConfig(command=command, env=TOKEN_ENV, log_path=log)) as process:
        link = listener.accept(20.0, lambda: None)
        listener.close()
        play(link, name, layout)
        assert process.wait(20.0) == (1 if name == "endless" else 0)
        link.close()
    return [line for line in log.read_text().splitlines() if ALARM.search(line)]


@pytest.mark.parametrize("name", ["rounds", "fall", "clean"])
@pytest.mark.parametrize("layout", ["isolated", "grid"])
def test_nothing_is_left_behind(
    godot4: InstalledEngine, project: Path, tmp_path: Path, name: str, layout: str
) -> None:
    assert last_words(godot4, project, tmp_path / "log", name, layout) == []


def test_a_beginning_that_never_ends_leaves_nothing(
    godot4: InstalledEngine, project: Path, tmp_path: Path
) -> None:
    lines = last_words(godot4, project, tmp_path / "log", "endless", "isolated")
    assert [line for line in lines if not line.startswith("Orphan StringName: ticked")] == []


@pytest.mark.parametrize("layout", ["isolated", "grid"])
def test_what_is_left_behind_is_told_once(
    godot4: InstalledEngine, project: Path, tmp_path: Path, layout: str
) -> None:
    lines = last_words(godot4, project, tmp_path / "log", "leaky", layout)
    told = [line for line in lines if "ludus" in line and "behind" in line]
    assert len(told) == 1
    assert told[0].startswith(WARNING)
    assert any("4 RID allocations of type" in line and "Body2D" in line for line in lines)
