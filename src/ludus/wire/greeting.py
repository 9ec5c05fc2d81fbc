"""The trainer's side of a greeting, until the engine has proved itself (PROTOCOL.md §3). No I/O."""

from __future__ import annotations

from collections.abc import Mapping

from ludus.errors import ProtocolError
from ludus.wire.frames import FrameType, decode_json, encode_json
from ludus.wire.handshake import GreetingRefused, Hello
from ludus.wire.json_object import JsonObject
from ludus.wire.proof import is_hex, is_proof, make_nonce, make_proof
from ludus.wire.state import ConnectionState, State

__all__ = ["Greeting"]


class Greeting:
    """``HELLO``, ``CHALLENGE`` and ``PROOF``; what follows is the session's.

    An engine of protocol 1 can prove nothing, and is done after its ``HELLO``.

    Args:
        token: The secret that the engine knows, too.
        takes_protocol_1: Whether it is known without a proof who is at the other end.

    Attributes:
        state: The state of the connection.
        hello: The engine's greeting; None as long as there is none.
        version: The protocol that both speak.
    """

    def __init__(self, token: str, *, takes_protocol_1: bool = False) -> None:
        if not token:
            raise ValueError("an empty token is no secret")
        self.state = ConnectionState()
        self.hello: Hello | None = None
        self.version = 0
        self._token = token
        self._takes_protocol_1 = takes_protocol_1
        self._nonce = make_nonce()
        self._engine_nonce = ""
        self._is_over = False

    @property
    def is_over(self) -> bool:
        """Whether the engine may be sent its ``WELCOME``."""
        return self._is_over

    def answer(self, frame_type: FrameType, payload: bytes) -> bytes | None:
        """Take in a frame that :attr:`state` has allowed; return the frame to send, if any.

        Raises:
            ProtocolError: The frame is malformed.
            GreetingRefused: There is no common version, or the proof is wrong.
        """
        value = decode_json(payload, frame_type.name)
        if frame_type is FrameType.HELLO:
            nonce = value.get("nonce")
            self._engine_nonce = nonce if isinstance(nonce, str) and is_hex(nonce) else ""
            return self._challenge(Hello.from_json(value))
        self._check_proof(JsonObject(value, "PROOF").text("proof"))
        return None

    def refusal(self, report: Mapping[str, str]) -> dict[str, str]:
        """Return the content of the ``ERROR`` that tells ``report``.

        It has our proof if it takes the place of a ``CHALLENGE``, as far as the engine's nonce is
        known: a game that listens ends only then.
        """
        if self.state.state is not State.GREETED or not self._engine_nonce:
            return dict(report)
        return {**report, **self._credentials()}

    def _credentials(self) -> dict[str, str]:
        proof = make_proof(self._token, "trainer", self._engine_nonce, self._nonce)
        return {"nonce": self._nonce, "proof": proof}

    def _challenge(self, hello: Hello) -> bytes | None:
        self.hello = hello
        self.version = hello.agree()
        if self.version == 1:
            if not self._takes_protocol_1:
                raise GreetingRefused(
                    "version",
                    "the game's add-on speaks protocol 1, in which a game cannot prove who it is; "
                    "that is enough only for a game that the trainer starts on its own machine",
                    hello.upgrade,
                )
            self._is_over = True
            return None
        if not self._engine_nonce:
            raise ProtocolError("HELLO.nonce: expected 64 hexadecimal digits")
        self.state.send(FrameType.CHALLENGE)
        content = {"protocol": self.version, **self._credentials()}
        return encode_json(FrameType.CHALLENGE, content)

    def _check_proof(self, proof: str) -> None:
        assert self._engine_nonce, "the state allows a PROOF only after a CHALLENGE"
        expected = make_proof(self._token, "engine", self._engine_nonce, self._nonce)
        if not is_proof(proof, expected):
            raise GreetingRefused(
                "token",
                "the game's token is not ours",
                "give both sides the same token file (--ludus-token-file, --token-file)",
            )
        self._is_over = True
