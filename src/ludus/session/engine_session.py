"""A conversation with an engine that speaks the Ludus protocol."""

from __future__ import annotations

import contextlib
import hmac
from collections.abc import Generator, Mapping, Sequence
from typing import Any

from ludus.batch import ActionBatch, Batches, StepTimes
from ludus.errors import (
    EngineError,
    EngineStartError,
    EngineTimeout,
    GameError,
    LudusError,
    ProtocolError,
    SequenceError,
    TargetError,
    UsageError,
)
from ludus.link import Link, LinkClosed
from ludus.session.finite import check_finite
from ludus.session.supervision import Supervision
from ludus.spec import PolicySpec, Spec
from ludus.wire.frames import FrameType, decode_json, encode_frame, encode_json
from ludus.wire.handshake import EngineConfig, Hello, welcome
from ludus.wire.reset import ResetRequest
from ludus.wire.spec_reader import read_spec
from ludus.wire.state import ConnectionState, State
from ludus.wire.step import BatchDecoder, StepEncoder

__all__ = ["EngineSession"]

_ENDINGS = (FrameType.ERROR, FrameType.CLOSE)


class EngineSession:
    """One engine, from greeting to goodbye.

    Args:
        link: Open connection.
        config: What to ask of the engine.
        supervision: The engine's process, if it is ours.
        token: Secret shared with an engine on another machine.
        step_timeout_s: Deadline of every answer, seconds.

    Raises:
        EngineStartError: Versions or tokens do not fit.
        TargetError: The scene cannot be trained; the text says why.
        EngineError: The engine died, froze or broke the protocol.
    """

    def __init__(
        self,
        link: Link,
        config: EngineConfig,
        supervision: Supervision,
        token: str = "",
        step_timeout_s: float = 60.0,
    ) -> None:
        self._link = link
        self._supervision = supervision
        self._state = ConnectionState()
        self._call_id = 0
        self._num_steps = 0
        try:
            self._hello = Hello.from_json(self._receive_json(FrameType.HELLO))
            version = self._agree(token)
            self._send(encode_json(FrameType.WELCOME, welcome(version, self._hello, config, token)))
            self._spec = read_spec(self._receive_json(FrameType.SPEC))
        except BaseException:
            self.close()
            raise
        self._policies = {policy.name: policy for policy in self._spec.policies}
        self._encoder = StepEncoder(self._spec)
        self._decoder = BatchDecoder(self._spec)
        link.timeout_s = step_timeout_s

    @property
    def spec(self) -> Spec:
        """What the engine declared."""
        return self._spec

    @property
    def policies(self) -> Mapping[str, PolicySpec]:
        """Policies by name, in wire order."""
        return self._policies

    @property
    def hello(self) -> Hello:
        """The engine's greeting: versions and capabilities."""
        return self._hello

    @property
    def times(self) -> StepTimes:
        """Where the time of the last step went."""
        return self._decoder.times

    @property
    def pid(self) -> int | None:
        """Process id of the engine; None if it is not ours."""
        return self._supervision.pid

    def reset(self, request: ResetRequest) -> Batches:
        """Begin new episodes (PROTOCOL.md §5).

        Returns:
            The first observations; views that the next answer overwrites.

        Raises:
            UsageError: The request does not fit the number of worlds.
            EngineError: The engine failed.
        """
        if len(request.seeds) != self._spec.num_worlds:
            raise UsageError(
                f"reset of {len(request.seeds)} worlds, the engine has {self._spec.num_worlds}"
            )
        frame = request.encode()
        self._state.send(FrameType.RESET)
        self._send(frame, note=False)
        return self.receive()

    def send(self, actions: Mapping[str, ActionBatch]) -> None:
        """Send the actions of all policies and return at once.

        Raises:
            SequenceError: ``reset`` was never called, or the last answer was not received.
            ActionError: A policy is missing, or its arrays have the wrong shape.
            EngineError: The engine has gone.
        """
        frame = self._encoder.encode(actions)
        self._state.send(FrameType.STEP)
        self._send(frame, note=False)

    def receive(self) -> Batches:
        """Wait for the answer to ``send``.

        Returns:
            Views that the next answer overwrites.

        Raises:
            SequenceError: Nothing was sent.
            GameError: The game reported a mistake, or sent NaN or infinity.
            EngineError: The engine died, froze or broke the protocol.
        """
        if self._state.state is not State.STEPPING:
            raise SequenceError("nothing to receive", hint="call reset() or send() first")
        with self._explained():
            frame_type, num_bytes = self._link.receive_into(self._decoder.buffer)
        if frame_type in _ENDINGS:
            self._raise_ending(frame_type, bytes(self._decoder.buffer[8 : 8 + num_bytes]))
        self._state.receive(frame_type)
        batches = self._decoder.decode(num_bytes)
        self._num_steps = 0 if self._decoder.is_reset else self._num_steps + 1
        try:
            check_finite(self._policies, batches, self._num_steps)
            self._supervision.check_script_errors()
        except EngineError:
            self.close()
            raise
        return batches

    def call(self, target: Mapping[str, Any], method: str, arguments: Sequence[Any] = ()) -> Any:
        """Call a method of the game (PROTOCOL.md §8) and return its JSON value.

        Raises:
            GameError: There is no such method or node.
            EngineError: The engine failed.
        """
        self._call_id += 1
        message = {"id": self._call_id, "target": dict(target), "method": method}
        self._send(encode_json(FrameType.CALL, {**message, "arguments": list(arguments)}))
        result = self._receive_json(FrameType.RESULT)
        if "error" in result:
            raise GameError(f"call of {method} failed: {result['error']}")
        return result.get("value")

    def ping(self, payload: bytes = b"") -> bytes:
        """Send bytes and wait until they come back."""
        self._send(encode_frame(FrameType.PING, payload))
        return self._receive(FrameType.PONG)

    def close(self) -> None:
        """Say goodbye and end the engine; may be called twice."""
        with contextlib.suppress(LinkClosed, LudusError):
            self._state.send(FrameType.CLOSE)
            self._link.timeout_s = 1.0
            self._link.send(encode_frame(FrameType.CLOSE))
        self._link.close()
        self._supervision.close()

    def _agree(self, token: str) -> int:
        if token and not hmac.compare_digest(token.encode(), self._hello.token.encode()):
            self._refuse("token", "the tokens differ")
            raise EngineStartError(
                "the engine sent another token", hint="give both sides the same token file"
            )
        try:
            return self._hello.agree()
        except EngineStartError as error:
            self._refuse("version", error.message, error.hint)
            raise

    def _refuse(self, code: str, message: str, hint: str = "") -> None:
        with contextlib.suppress(EngineError):
            report = {"code": code, "message": message, "hint": hint}
            self._send(encode_json(FrameType.ERROR, report))

    def _send(self, frame: bytes | bytearray, *, note: bool = True) -> None:
        if note:
            self._state.send(FrameType(frame[4]))
        with self._explained():
            self._link.send(frame)

    def _receive(self, expected: FrameType) -> bytes:
        with self._explained():
            frame_type, payload = self._link.receive()
        if frame_type in _ENDINGS:
            self._raise_ending(frame_type, payload)
        self._state.receive(frame_type)
        return payload

    def _receive_json(self, expected: FrameType) -> dict[str, Any]:
        return decode_json(self._receive(expected), expected.name)

    def _raise_ending(self, frame_type: FrameType, payload: bytes) -> None:
        """Raise what it means that the engine sent ``frame_type`` instead of an answer."""
        self._state.receive(frame_type)
        if frame_type is FrameType.ERROR:
            error = self._engine_error(decode_json(payload, "ERROR"))
        else:
            error = self._supervision.explain("the engine closed the connection")
        self.close()
        raise error

    def _engine_error(self, report: Mapping[str, Any]) -> LudusError:
        message, hint = str(report.get("message", "")), str(report.get("hint", ""))
        message += self._supervision.script_errors()
        kinds: dict[str, type[LudusError]] = {
            "config": TargetError,
            "game": GameError,
            "version": EngineStartError,
            "token": EngineStartError,
        }
        return kinds.get(str(report.get("code")), ProtocolError)(message, hint)

    @contextlib.contextmanager
    def _explained(self) -> Generator[None]:
        """Turn the end of the link into an error that says what became of the engine."""
        try:
            yield
        except LinkClosed as error:
            explained = self._supervision.explain("the connection to the engine ended")
            self.close()
            raise explained from error
        except EngineTimeout as error:
            frozen = self._supervision.explain_silence(error)
            self.close()
            raise frozen from error
        except ProtocolError:
            self.close()
            raise
