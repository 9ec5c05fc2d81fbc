"""A session with an engine that speaks the Ludus protocol."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Generator, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ludus.errors import (
    EngineStartError,
    EngineTimeout,
    GameError,
    LudusError,
    ProtocolError,
    SequenceError,
    SetupError,
    TargetError,
    UsageError,
)
from ludus.link import Link, LinkClosed
from ludus.session.supervision import Supervision
from ludus.spec import PolicySpec
from ludus.spec.batch import ActionBatch, Batches, StepTimes
from ludus.spec.finite import check_finite
from ludus.wire.error_report import error_report
from ludus.wire.frames import FrameType, decode_json, encode_frame, encode_json
from ludus.wire.greeting import Greeting
from ludus.wire.handshake import EngineConfig, Hello, welcome
from ludus.wire.requests import CAPABILITY as REQUESTS
from ludus.wire.requests import METRICS, MetricSummary, add_metrics, read_requests, split_metrics
from ludus.wire.reset import ResetAction, ResetRequest
from ludus.wire.spec_reader import read_spec
from ludus.wire.state import State
from ludus.wire.step import BatchDecoder, StepEncoder

__all__ = ["BRIDGE", "EngineSession", "RendererMissing"]

_ENDINGS = (FrameType.ERROR, FrameType.CLOSE)
_CLOSE_TIMEOUT_S = 1.0
BRIDGE = {"bridge": True}
"""Target of calls of the add-on's own methods (PROTOCOL.md §8)."""


class RendererMissing(SetupError):  # noqa: N818 - reads as what happened
    """The game has cameras, but its engine runs without a renderer (PROTOCOL.md §9)."""


class EngineSession:
    """One engine, from ``HELLO`` to ``CLOSE``.

    Args:
        link: Open connection.
        config: What to ask of the engine.
        supervision: The engine's process, if it is ours.
        greeting: How far the greeting has come on this link; the session goes on with it.
        step_timeout_s: Deadline of every answer, seconds.

    Attributes:
        hello: The engine's greeting: versions and capabilities.
        spec: What the engine declared.
        policies: Policies by name, in wire order.

    Raises:
        EngineStartError: Versions or tokens do not match, or the game never sent its spec.
        TargetError: The scene cannot be trained; the text says why.
        EngineError: The engine died, froze or broke the protocol.
    """

    _more_capabilities: ClassVar[frozenset[str]] = frozenset()
    """Capabilities that this kind of session has in addition to those of all."""

    def __init__(
        self,
        link: Link,
        config: EngineConfig,
        supervision: Supervision,
        greeting: Greeting,
        step_timeout_s: float = 60.0,
    ) -> None:
        self._link = link
        self._creator_pid = os.getpid()
        self._supervision = supervision
        self._greeting = greeting
        self._state = greeting.state
        self._call_id = 0
        self._num_steps = 0
        self._requests: list[dict[str, Any]] = []
        self._metrics: dict[str, MetricSummary] = {}
        try:
            self.hello = self._greet(greeting)
            answer = welcome(greeting.version, self.hello, config, self._more_capabilities)
            self._send(FrameType.WELCOME, encode_json(FrameType.WELCOME, answer))
            self.spec = read_spec(self._receive_json(FrameType.SPEC))
        except EngineTimeout as error:
            raise EngineStartError(
                f"the game did not send its spec in time: {error.message}",
                hint="its scene may hang in a loop; if it only loads slowly, raise start_timeout_s",
            ) from error
        except LudusError as error:
            self.fail(error)
            raise
        except BaseException:
            self.close()
            raise
        self.policies: Mapping[str, PolicySpec] = {
            policy.name: policy for policy in self.spec.policies
        }
        self._encoder = StepEncoder(self.spec)
        self._decoder = BatchDecoder(self.spec)
        link.timeout_s = step_timeout_s
        self._spin_s = config.spin_us * 1e-6
        if config.spin_us:
            link.spin(self._spin_s)

    @property
    def times(self) -> StepTimes:
        """How the time of the last step was spent."""
        return self._decoder.times

    @property
    def pid(self) -> int | None:
        """Process id of the engine; None if it is not ours."""
        return self._supervision.pid

    @property
    def has_requests(self) -> bool:
        """Whether requests of the game were waiting as of the last answer."""
        is_told = self._decoder.has_requests and REQUESTS in self.hello.capabilities
        return is_told or bool(self._requests)

    def reset(self, request: ResetRequest) -> Batches:
        """Begin new episodes (PROTOCOL.md §5).

        Returns:
            The first observations; views that the next answer overwrites.

        Raises:
            UsageError: The request does not fit the number of worlds, or leaves some alone, which
                this engine cannot do.
            EngineError: The engine failed.
        """
        if len(request.seeds) != self.spec.num_worlds:
            raise UsageError(
                f"reset of {len(request.seeds)} worlds, the engine has {self.spec.num_worlds}"
            )
        if ResetAction.LEAVE in request.actions:
            self._require("reset_worlds", "reset some of its worlds and leave the others alone")
        self._send(FrameType.RESET, request.encode())
        return self.receive()

    def send(self, actions: Mapping[str, ActionBatch]) -> None:
        """Send the actions of all policies and return at once.

        Raises:
            SequenceError: ``reset`` was never called, or the last answer was not received.
            ActionError: A policy is missing, or its arrays have the wrong shape.
            EngineError: The engine is gone.
        """
        self._send(FrameType.STEP, self._encoder.encode(actions))

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
        try:  # as _wrap_errors, but a context manager would cost two more calls in every step
            num_bytes = self._link.receive_into(self._decoder.buffer, FrameType.BATCH)
            if num_bytes is None:
                self._next_payload()  # raises, since only a BATCH may answer a step
            assert num_bytes is not None
            self._state.receive(FrameType.BATCH)
            batches = self._decoder.decode(num_bytes)
            self._num_steps = 0 if self._decoder.is_reset else self._num_steps + 1
            if not self._decoder.all_finite_fast():
                check_finite(self.policies, batches, self._num_steps)
            self._supervision.check_script_errors()
        except BaseException as error:
            self._close_after(error)
            raise
        return batches

    def hold(self, worlds: NDArray[np.bool_]) -> bool:
        """False: a step of an engine is one of all its worlds."""
        return False

    def call(self, target: Mapping[str, Any], method: str, arguments: Sequence[Any] = ()) -> Any:
        """Call a method of the game (PROTOCOL.md §8) and return its JSON value.

        Raises:
            UsageError: The arguments are not JSON, or the engine takes no such calls.
            GameError: There is no such method or node.
            EngineError: The engine failed.
        """
        if target != BRIDGE:
            self._require("call", f"call {method}")
        elif method == "run_ceiling":
            self._require("ceiling", "measure how fast the game runs by itself")
        self._call_id += 1
        message = {"id": self._call_id, "target": dict(target), "method": method}
        try:
            frame = encode_json(FrameType.CALL, {**message, "arguments": list(arguments)})
        except (TypeError, ValueError) as error:
            raise UsageError(f"the arguments of {method} must be JSON: {error}") from error
        self._send(FrameType.CALL, frame)
        result = self._receive_json(FrameType.RESULT)
        if result.get("id") != self._call_id:
            with self._wrap_errors():
                raise ProtocolError(f"RESULT of call {result.get('id')}, expected {self._call_id}")
        if "error" in result:
            raise GameError(f"call of {method} failed: {result['error']}")
        return result.get("value")

    def take_requests(self) -> list[dict[str, Any]]:
        """Fetch the game's requests; see :func:`ludus.wire.requests.read_requests`.

        The engine is asked only if it has announced requests.

        Returns:
            The requests, oldest first.

        Raises:
            SequenceError: The answer to ``send`` was not received yet.
            ProtocolError: The engine's answer is not a list of requests.
            EngineError: The engine failed.
        """
        if self.has_requests:
            self._fetch()
        taken, self._requests = self._requests, []
        return taken

    def take_metrics(self) -> dict[str, MetricSummary]:
        """Fetch what the game has reported since the last time, by name.

        One round trip, for a game that can report metrics; see :meth:`take_requests`.
        """
        if METRICS in self.hello.capabilities:
            self._fetch()
        taken, self._metrics = self._metrics, {}
        return taken

    def _fetch(self) -> None:
        """Ask for requests and metrics, which come together."""
        value = self.call(BRIDGE, "take_requests")
        with self._wrap_errors():
            requests, metrics = split_metrics(read_requests(value))
        self._decoder.has_requests = False
        self._requests += requests
        self._metrics = add_metrics(self._metrics, metrics)

    def show_status(self, status: Mapping[str, Any]) -> None:
        """Report the progress of training to the game; does nothing if it cannot show it.

        Args:
            status: ``{"agent_steps": int, "updates": int, "policies": {name: {"mode": word,
                "mean_return": float or None}}}``; plain JSON, without NaN.

        Raises:
            UsageError: The status is not JSON.
            SequenceError: The answer to ``send`` was not received yet.
            EngineError: The engine failed.
        """
        if REQUESTS in self.hello.capabilities:
            has_requests = self.call(BRIDGE, "show_status", [dict(status)])
            self._decoder.has_requests |= has_requests is True

    def fail(self, error: LudusError) -> None:
        """Tell the game why the session ends, and end it; does nothing once it has ended."""
        report = self._greeting.refusal(error_report(error))
        with contextlib.suppress(LinkClosed, LudusError):
            self._state.send(FrameType.ERROR)
            self._link.timeout_s = _CLOSE_TIMEOUT_S
            self._link.send(encode_json(FrameType.ERROR, report))
        self.close()

    def close(self) -> None:
        """Send ``CLOSE`` and end the engine; may be called twice.

        In a forked process it only lets go of the connection: the engine is its parent's.
        """
        if os.getpid() != self._creator_pid:
            self._link.close()
            return
        with contextlib.suppress(LinkClosed, LudusError):
            self._state.send(FrameType.CLOSE)
            self._link.timeout_s = _CLOSE_TIMEOUT_S
            self._link.send(encode_frame(FrameType.CLOSE))
        self._link.close()
        self._supervision.close()

    def _greet(self, greeting: Greeting) -> Hello:
        """Finish the greeting; return the engine's ``HELLO``."""
        with self._wrap_errors():
            while not greeting.is_over:
                answer = greeting.answer(*self._next_frame())
                if answer is not None:
                    self._link.send(answer)
        assert greeting.hello is not None, "it is over"
        return greeting.hello

    def _require(self, capability: str, what: str) -> None:
        """Raise unless the engine has a capability (PROTOCOL.md §3)."""
        if capability not in self.hello.capabilities:
            raise UsageError(
                f"{self.hello.engine} cannot {what}: it lacks the capability {capability}",
                hint="PROTOCOL.md §3 lists the capabilities that an engine may have",
            )

    def _send(self, frame_type: FrameType, frame: bytes | bytearray) -> None:
        if os.getpid() != self._creator_pid:
            raise SequenceError(
                f"the engine was started by process {self._creator_pid}, and process {os.getpid()} "
                "is a forked copy of it, which would share its connection",
                hint="start a game in the forked process: ludus.make(…), or pickle the environment",
            )
        if self._link.has_pending:
            self._receive()  # raises, since no answer is due
        self._state.send(frame_type)
        try:  # see receive
            self._link.send(frame)
        except BaseException as error:
            self._close_after(error)
            raise

    def _receive(self) -> bytes:
        with self._wrap_errors():
            return self._next_payload()

    def _receive_json(self, frame_type: FrameType) -> dict[str, Any]:
        with self._wrap_errors():
            return decode_json(self._next_payload(), frame_type.name)

    def _next_payload(self) -> bytes:
        return self._next_frame()[1]

    def _next_frame(self) -> tuple[FrameType, bytes]:
        frame_type, payload = self._link.receive()
        self._state.receive(frame_type)
        if frame_type in _ENDINGS:
            raise self._error_of(frame_type, payload)
        return frame_type, payload

    def _error_of(self, frame_type: FrameType, payload: bytes) -> LudusError:
        """Return the error for a ``CLOSE`` or ``ERROR`` that came instead of an answer."""
        if frame_type is FrameType.CLOSE:
            return self._supervision.explain("the engine closed the connection")
        report = decode_json(payload, "ERROR")
        message, hint = str(report.get("message", "")), str(report.get("hint", ""))
        message += self._supervision.script_errors()
        kinds: dict[str, type[LudusError]] = {
            "config": TargetError,
            "game": GameError,
            "version": EngineStartError,
            "token": EngineStartError,
            "renderer": RendererMissing,
        }
        return kinds.get(str(report.get("code")), ProtocolError)(message, hint)

    @contextlib.contextmanager
    def _wrap_errors(self) -> Generator[None]:
        """End the session if an error leaves this context."""
        try:
            yield
        except BaseException as error:
            self._close_after(error)
            raise

    def _close_after(self, error: BaseException) -> None:
        """End the session after an error; raise a clearer one if the engine is gone or silent."""
        if isinstance(error, LinkClosed):
            explained = self._supervision.explain("the connection to the engine ended")
            self.close()
            raise explained from error
        if isinstance(error, EngineTimeout):
            frozen = self._supervision.explain_silence(error)
            self.fail(error)
            raise frozen from error
        if isinstance(error, LudusError):
            self.fail(error)
