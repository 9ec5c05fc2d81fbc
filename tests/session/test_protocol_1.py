"""Games made before protocol 2: where they still play, and where they are refused."""

from __future__ import annotations

import contextlib
import logging
import sys
from pathlib import Path

import pytest

from ludus.errors import ProtocolError
from ludus.session import open_session, opening
from ludus.target import Executable
from ludus.wire.handshake import EngineConfig, GreetingRefused
from tests.session.conftest import reset, step

ROOT = Path(__file__).parents[2]
OLD_GAME = f"""#!{sys.executable}
import os, socket, sys
sys.path.insert(0, {str(ROOT)!r})
from tests.fake_engine import FLAT, Talk
from tests.wire.golden import load

(value,) = [word.partition("=")[2] for word in sys.argv if word.startswith("--ludus-connect=")]
address = value.split(",")[{{which}}]
kind, _, place = address.partition(":")
if kind == "unix":
    connection = socket.socket(socket.AF_UNIX)
    connection.connect(place)
else:
    connection = socket.create_connection((place.rpartition(":")[0], int(place.rpartition(":")[2])))
talk = Talk(connection, FLAT)
hello = {{{{**load("hello_protocol_1").content, "engine": load("hello").content["engine"]}}}}
hello["protocol"] = {{versions}}
hello["training"] = {{{{}}}}  # as a game that guides its training has it
talk.json("HELLO", hello)
name, payload = talk.read()
if name != "WELCOME":
    print("ludus:", payload.decode(), flush=True)
    sys.exit(1)
talk.json("SPEC", FLAT)
talk.serve()
"""


def write_game(folder: Path, which: int = -1, versions: str = '{"min": 1, "max": 1}') -> Executable:
    """Write a program that is a game with an old add-on."""
    program = folder / "game"
    program.write_text(OLD_GAME.format(which=which, versions=versions))
    program.chmod(0o755)
    return Executable(program)


@pytest.mark.slow
@pytest.mark.parametrize("which", [0, -1], ids=["unix", "tcp"])
def test_a_game_that_is_started_here_plays_with_one_warning(
    tmp_path: Path, which: int, caplog: pytest.LogCaptureFixture
) -> None:
    opening._warn_of_protocol_1.cache_clear()  # pyright: ignore[reportPrivateUsage]
    game = write_game(tmp_path, which)
    with caplog.at_level(logging.WARNING):
        for _ in range(2):
            with contextlib.closing(open_session(game, EngineConfig(num_worlds=3))) as session:
                reset(session)
                step(session)
    (warning,) = [record.getMessage() for record in caplog.records if "protocol" in record.msg]
    assert "ludus addon install" in warning


def test_a_game_with_no_common_version_ends_and_says_why(tmp_path: Path) -> None:
    game = write_game(tmp_path, versions='{"min": 7, "max": 9}')
    with pytest.raises(GreetingRefused, match="the Python package is too old") as caught:
        open_session(game, EngineConfig())
    assert "pip install --upgrade" in caught.value.hint


def test_a_game_that_claims_both_versions_must_prove_itself(tmp_path: Path) -> None:
    """Or a stranger could choose to prove nothing."""
    game = write_game(tmp_path, versions='{"min": 1, "max": 2}')
    with pytest.raises(ProtocolError, match=r"HELLO\.nonce"):
        open_session(game, EngineConfig())
