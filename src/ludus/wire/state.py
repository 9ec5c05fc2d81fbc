"""The connection's state machine as a table (PROTOCOL.md §2), from the trainer's side."""

from __future__ import annotations

from enum import IntEnum, auto

from ludus.errors import ProtocolError, SequenceError
from ludus.wire.frames import FrameType

__all__ = ["ConnectionState", "State"]


class State(IntEnum):
    """State of a connection, as the trainer sees it."""

    CONNECTED = auto()
    GREETED = auto()
    CHALLENGED = auto()
    PROVEN = auto()
    CONFIGURED = auto()
    READY = auto()
    STEPPING = auto()
    CALLING = auto()
    PINGING = auto()
    CLOSED = auto()


_OPEN_STATES = [state for state in State if state is not State.CLOSED]
_ENDINGS = {(state, kind): State.CLOSED for state in _OPEN_STATES for kind in (11, 12)}

SENT: dict[tuple[State, int], State] = {
    (State.GREETED, FrameType.CHALLENGE): State.CHALLENGED,
    (State.GREETED, FrameType.WELCOME): State.CONFIGURED,  # protocol 1
    (State.PROVEN, FrameType.WELCOME): State.CONFIGURED,
    (State.READY, FrameType.RESET): State.STEPPING,
    (State.READY, FrameType.STEP): State.STEPPING,
    (State.READY, FrameType.CALL): State.CALLING,
    (State.READY, FrameType.PING): State.PINGING,
    **_ENDINGS,
}
"""(state, type of the frame the trainer sends) → next state."""

RECEIVED: dict[tuple[State, int], State] = {
    (State.CONNECTED, FrameType.HELLO): State.GREETED,
    (State.CHALLENGED, FrameType.PROOF): State.PROVEN,
    (State.CONFIGURED, FrameType.SPEC): State.READY,
    (State.STEPPING, FrameType.BATCH): State.READY,
    (State.CALLING, FrameType.RESULT): State.READY,
    (State.PINGING, FrameType.PONG): State.READY,
    **_ENDINGS,
}
"""(state, type of the frame the engine sends) → next state."""

_ADVICE = {State.STEPPING: "receive the answer to the last step first"}


class ConnectionState:
    """Tracks one connection and refuses frames that its state does not allow."""

    def __init__(self) -> None:
        self.state = State.CONNECTED
        self.has_reset = False

    def send(self, frame_type: FrameType) -> None:
        """Record that the trainer sends a frame.

        Raises:
            SequenceError: The frame is not allowed now.
        """
        following = SENT.get((self.state, frame_type))
        if following is None:
            if self.state is State.CLOSED:
                raise SequenceError("the environment is closed", "make a new one")
            hint = _ADVICE.get(self.state, "")
            raise SequenceError(f"{frame_type.name} is not allowed in {self.state.name}", hint)
        if frame_type is FrameType.STEP and not self.has_reset:
            raise SequenceError("step before the first reset", hint="call reset() first")
        self.has_reset = self.has_reset or frame_type is FrameType.RESET
        self.state = following

    def allow(self, frame_type: FrameType) -> State:
        """Return the state after a frame whose header the engine has sent.

        Raises:
            ProtocolError: The frame is not allowed now.
        """
        following = RECEIVED.get((self.state, frame_type))
        if following is None:
            raise ProtocolError(f"the engine sent {frame_type.name} in {self.state.name}")
        return following

    def receive(self, frame_type: FrameType) -> None:
        """Record that the engine sent a frame; raises as :meth:`allow`."""
        self.state = self.allow(frame_type)
