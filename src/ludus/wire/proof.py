"""Proofs that a side knows the token, without telling it (PROTOCOL.md §3). No input or output."""

from __future__ import annotations

import hashlib
import hmac
import re
import secrets
from typing import Literal

__all__ = ["MIN_TOKEN_LENGTH", "Role", "is_hex", "is_proof", "make_nonce", "make_proof"]

MIN_TOKEN_LENGTH = 16
"""Of tokens that people write, characters."""
Role = Literal["engine", "trainer"]

_NONCE_BYTES = 32
_HEX = re.compile(r"[0-9a-f]{64}")


def make_nonce() -> str:
    """Return 64 random hexadecimal digits, which no other greeting has."""
    return secrets.token_hex(_NONCE_BYTES)


def is_hex(text: str) -> bool:
    """Return whether a text has the form of a nonce and of a proof."""
    return _HEX.fullmatch(text) is not None


def make_proof(token: str, role: Role, engine_nonce: str, trainer_nonce: str) -> str:
    """Return the proof of one side, as 64 hexadecimal digits.

    The role is part of it, so that nobody can send a proof back to the side that made it.

    Args:
        token: The secret that both sides know.
        role: The side whose proof it is.
        engine_nonce: Nonce of the ``HELLO``.
        trainer_nonce: Nonce of the ``CHALLENGE``, or of the ``ERROR`` in its place.
    """
    label = f"ludus 2 {role}".encode()
    message = label + bytes.fromhex(engine_nonce) + bytes.fromhex(trainer_nonce)
    return hmac.new(token.encode(errors="surrogatepass"), message, hashlib.sha256).hexdigest()


def is_proof(proof: str, expected: str) -> bool:
    """Compare a proof with the one expected, in a time that tells nothing about the difference."""
    return hmac.compare_digest(proof.encode(errors="surrogatepass"), expected.encode())
