"""What a real engine does with a trainer that breaks the rules: it says why, and quits."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from typing import Any

import pytest

from ludus.engine import (
    EngineProcess,
    GodotFlags,
    LaunchConfig,
    ensure_imported,
    find_engine,
    godot_command,
    read_project,
)
from ludus.engine.project import RUN_SCENE
from ludus.link import Link, LinkClosed, Listener
from ludus.wire.frames import FrameType
from tests.godot.conftest import Game
from tests.raw_trainer import TOKEN_ENV, greet
from tests.wire.golden import load
from tests.wire.reference import frame, json_frame

pytestmark = pytest.mark.engine

WELCOME = {**load("welcome").content, "config": {"scene": "res://right.tscn", "num_worlds": 2}}
RESET = frame("RESET", struct.pack("<II", 2, 4) + bytes(16) + bytes([2, 2]) + bytes(6) + b"null")
STEP = frame("STEP", bytes(16))


class Trainer:
    """A trainer without manners."""

    def __init__(self, game: Game) -> None:
        project = read_project(game.folder)
        engine = find_engine(project.engine_kind)
        ensure_imported(engine, project)
        listener = Listener()
        flags = GodotFlags(user_args=(f"--ludus-connect={','.join(listener.addresses)}",))
        command = godot_command(engine, project.root, RUN_SCENE, flags)
        self.process = EngineProcess.start(LaunchConfig(command=command, env=TOKEN_ENV))
        self.link: Link = listener.accept(20.0, lambda: None)
        listener.close()
        self.hello = greet(self.link)

    def expect(self, frame_type: FrameType) -> Any:
        got, payload = self.link.receive()
        assert got is frame_type, payload
        return payload if frame_type is FrameType.BATCH else json.loads(payload)

    def ready(self) -> None:
        self.link.send(json_frame("WELCOME", WELCOME))
        spec = self.expect(FrameType.SPEC)
        assert spec["num_worlds"] == 2

    def reset(self) -> None:
        self.link.send(RESET)
        self.expect(FrameType.BATCH)

    def expect_the_end(self, exit_code: int) -> None:
        with pytest.raises(LinkClosed):
            self.link.receive()
        assert self.process.wait(20.0) == exit_code, self.process.last_lines()

    def close(self) -> None:
        self.link.close()
        self.process.terminate()


@pytest.fixture
def trainer(game: Game) -> Iterator[Trainer]:
    made = Trainer(game)
    yield made
    made.close()


def test_the_rules_can_be_kept(trainer: Trainer) -> None:
    trainer.ready()
    trainer.reset()
    trainer.link.send(STEP)
    batch = trainer.expect(FrameType.BATCH)
    # tick and flags of §7: one tick has passed since the start, and this is no reset.
    tick, _, _, _, flags = struct.unpack_from("<QIIII", batch)
    assert (tick > 0, flags) == (True, 0)
    trainer.link.send(frame("PING", b"\x00\xff"))
    assert trainer.link.receive() == (FrameType.PONG, b"\x00\xff")
    trainer.link.send(frame("CLOSE", b""))
    trainer.expect_the_end(exit_code=0)


def choices(*numbers: int) -> bytes:
    return frame("STEP", struct.pack(f"<{len(numbers)}q", *numbers))


SLOT_1 = "STEP, policy agent, slot 1, action action"
# what the trainer sends, whether it has reset, the code and a part of the message
VIOLATIONS: dict[str, tuple[bytes, bool, str, str]] = {
    "step before reset": (STEP, False, "sequence", "before the first RESET"),
    "short step": (frame("STEP", bytes(8)), True, "frame", "STEP has 8 bytes, expected 16"),
    "long step": (frame("STEP", bytes(24)), True, "frame", "STEP has 24 bytes, expected 16"),
    "choice above": (choices(0, 2), True, "frame", f"{SLOT_1}: expected 0 to 1, got 2"),
    "choice below": (choices(0, -1), True, "frame", f"{SLOT_1}: expected 0 to 1, got "),
    "malformed reset": (frame("RESET", bytes(8)), True, "frame", "malformed RESET"),
    "second welcome": (json_frame("WELCOME", WELCOME), True, "sequence", "type 2"),
    "frame of an engine": (frame("BATCH", b""), True, "frame", "type 6"),
    "unknown type": (struct.pack("<IBBH", 0, 77, 0, 0), True, "frame", "type 77"),
    "type 0": (bytes(8), True, "frame", "type 0"),
    "oversized": (struct.pack("<IBBH", 2**32 - 1, 5, 0, 0), True, "frame", "4294967295 bytes"),
    "close with a payload": (frame("CLOSE", b"x"), True, "frame", "type 12 with 1 bytes"),
    "flags": (struct.pack("<IBBH", 0, 12, 1, 0), True, "frame", "flags"),
}


@pytest.mark.parametrize("name", VIOLATIONS)
def test_a_violation_is_answered_and_ends_the_game(trainer: Trainer, name: str) -> None:
    data, is_reset_first, code, message = VIOLATIONS[name]
    trainer.ready()
    if is_reset_first:
        trainer.reset()
    trainer.link.send(data)
    report = trainer.expect(FrameType.ERROR)
    assert report["code"] == code
    assert message in report["message"]
    trainer.expect_the_end(exit_code=1)


@pytest.mark.parametrize("num_bytes", [0, 5, 12])
def test_a_trainer_that_leaves_ends_the_game(trainer: Trainer, num_bytes: int) -> None:
    trainer.ready()
    trainer.reset()
    trainer.link.send(STEP[:num_bytes])
    trainer.link.close()
    assert trainer.process.wait(20.0) is not None


@pytest.mark.parametrize(
    ("answer", "code", "message"),
    [
        ({**WELCOME, "protocol": 3}, "version", "protocol 3"),
        ({**WELCOME, "config": 7}, "config", "config is no object"),
        ({**WELCOME, "config": {"layout": "ring"}}, "config", "ring"),
    ],
)
def test_a_welcome_that_does_not_fit(
    trainer: Trainer, answer: dict[str, Any], code: str, message: str
) -> None:
    trainer.link.send(json_frame("WELCOME", answer))
    report = trainer.expect(FrameType.ERROR)
    assert report["code"] == code
    assert message in report["message"]
    trainer.expect_the_end(exit_code=1)


def test_a_spec_instead_of_a_welcome(trainer: Trainer) -> None:
    trainer.link.send(frame("PING", b""))
    assert trainer.expect(FrameType.ERROR)["code"] == "sequence"
    trainer.expect_the_end(exit_code=1)


def test_a_trainer_that_is_silent_for_too_long(trainer: Trainer) -> None:
    config = {**WELCOME["config"], "idle_timeout_s": 1}
    trainer.link.send(json_frame("WELCOME", {**WELCOME, "config": config}))
    trainer.expect(FrameType.SPEC)
    report = trainer.expect(FrameType.ERROR)
    assert (report["code"], report["message"]) == (
        "timeout",
        "the trainer was silent for too long",
    )
    assert trainer.process.wait(20.0) is not None
    assert any("silent for too long" in line for line in trainer.process.last_lines())
