"""The trainer's part of a greeting, for tests that talk with a real engine frame by frame."""

from __future__ import annotations

from ludus.link import Link
from ludus.wire.greeting import Greeting
from ludus.wire.handshake import Hello
from tests.fake_engine import TOKEN

TOKEN_ENV = {"LUDUS_TOKEN": TOKEN}
"""Environment of the engine."""


def greet(link: Link) -> Hello:
    """Go through the greeting, up to the engine's proof."""
    greeting = Greeting(TOKEN)
    while not greeting.is_over:
        frame_type, payload = link.receive()
        greeting.state.receive(frame_type)
        answer = greeting.answer(frame_type, payload)
        if answer is not None:
            link.send(answer)
    assert greeting.hello is not None
    return greeting.hello
