"""The state machine, pair by pair, against the table of PROTOCOL.md §2."""

from __future__ import annotations

import re
from itertools import product
from pathlib import Path

import pytest

from ludus.errors import ProtocolError, SequenceError
from ludus.wire.frames import FrameType
from ludus.wire.state import ConnectionState, State

PROTOCOL = (Path(__file__).parents[2] / "protocol" / "PROTOCOL.md").read_text(encoding="utf-8")
Table = dict[tuple[State, FrameType], State]


def parse_cell(state: State, cell: str) -> Table:
    """Read ``RESET``, ``STEP`` → ``STEPPING``; ``PING`` → ``PINGING``."""
    table: Table = {}
    for part in cell.split(";"):
        names = re.findall(r"`([A-Z]+)`", part)
        table |= {(state, FrameType[name]): State[names[-1]] for name in names[:-1]}
    return table


def parse_tables() -> tuple[Table, Table]:
    section = PROTOCOL.split("## 2. States")[1].split("## 3.")[0]
    sent: Table = {}
    received: Table = {}
    for name, trainer, engine in re.findall(r"^\| `(\w+)` \| (.*?) \| (.*?) \|$", section, re.M):
        sent |= parse_cell(State[name], trainer)
        received |= parse_cell(State[name], engine)
    assert "In every state but `CLOSED` both may send `ERROR` or `CLOSE`" in section
    for state, frame_type in product(State, (FrameType.ERROR, FrameType.CLOSE)):
        if state is not State.CLOSED:
            sent[state, frame_type] = received[state, frame_type] = State.CLOSED
    return sent, received


SENT, RECEIVED = parse_tables()
PAIRS = list(product(State, FrameType))


def connection_in(state: State) -> ConnectionState:
    connection = ConnectionState()
    connection.state = state
    connection.has_reset = True
    return connection


def test_the_table_was_found() -> None:
    assert len(SENT) == 7 + 18
    assert len(RECEIVED) == 6 + 18


@pytest.mark.parametrize(("state", "frame_type"), PAIRS)
def test_only_the_frames_of_the_table_may_be_sent(state: State, frame_type: FrameType) -> None:
    connection = connection_in(state)
    following = SENT.get((state, frame_type))
    if following is None:
        said = f"{frame_type.name} .* {state.name}"
        if state is State.CLOSED:
            said = "the environment is closed"
        with pytest.raises(SequenceError, match=said):
            connection.send(frame_type)
        assert connection.state is state
    else:
        connection.send(frame_type)
        assert connection.state is following


@pytest.mark.parametrize(("state", "frame_type"), PAIRS)
def test_only_the_frames_of_the_table_may_be_received(state: State, frame_type: FrameType) -> None:
    connection = connection_in(state)
    following = RECEIVED.get((state, frame_type))
    if following is None:
        with pytest.raises(ProtocolError, match=f"{frame_type.name} in {state.name}"):
            connection.receive(frame_type)
        assert connection.state is state
    else:
        connection.receive(frame_type)
        assert connection.state is following


def test_a_new_connection_waits_for_hello() -> None:
    assert ConnectionState().state is State.CONNECTED


def test_step_needs_a_reset_first() -> None:
    connection = connection_in(State.READY)
    connection.has_reset = False
    with pytest.raises(SequenceError, match=r"(?s)step before the first reset.*call reset\(\)"):
        connection.send(FrameType.STEP)
    assert connection.state is State.READY
    for send, receive in [(FrameType.RESET, FrameType.BATCH), (FrameType.STEP, FrameType.BATCH)]:
        connection.send(send)
        connection.receive(receive)
    assert connection.state is State.READY


def test_a_call_does_not_count_as_a_reset() -> None:
    connection = connection_in(State.READY)
    connection.has_reset = False
    connection.send(FrameType.CALL)
    connection.receive(FrameType.RESULT)
    with pytest.raises(SequenceError):
        connection.send(FrameType.STEP)
