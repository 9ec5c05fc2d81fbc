"""The game's side of the wire in a thread, for tests without an engine."""

from __future__ import annotations

import contextlib
import json
import socket
import threading
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

CONVERSATION = Path(__file__).with_name("apple_seeker.jsonl")
TIMEOUT_S = 20.0

Serve = Callable[[socket.socket], None]
Answer = Callable[[dict[str, Any]], bytes | None]


@contextlib.contextmanager
def playing(serve: Serve) -> Generator[tuple[str, int]]:
    """Listen at a free port, and let ``serve`` talk with the first who connects."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.settimeout(TIMEOUT_S)
        thread = threading.Thread(target=_run, args=(listener, serve))
        thread.start()
        try:
            yield listener.getsockname()
        finally:
            # Whoever waits for a client that never came gets one that leaves at once.
            socket.create_connection(listener.getsockname()).close()
            thread.join(TIMEOUT_S)
            assert not thread.is_alive()


def _run(listener: socket.socket, serve: Serve) -> None:
    connection = listener.accept()[0]
    with connection, contextlib.suppress(ConnectionError):
        connection.settimeout(TIMEOUT_S)
        serve(connection)


def read_request(connection: socket.socket) -> bytes | None:
    """Return the bytes of one request, or None at the end."""
    header = _read(connection, 4)
    return None if header is None else _read(connection, int.from_bytes(header, "little"))


def send_answer(connection: socket.socket, answer: bytes) -> None:
    connection.sendall(len(answer).to_bytes(4, "little") + answer)


def answering(answer: Answer) -> Serve:
    """Answer each request by ``answer``; None: not at all."""

    def serve(connection: socket.socket) -> None:
        while (request := read_request(connection)) is not None:
            text = answer(json.loads(request))
            if text is not None:
                send_answer(connection, text)

    return serve


def replay(connection: socket.socket) -> None:
    """Answer what a real game answered, and hang up if it is asked something else."""
    for line in CONVERSATION.read_text().splitlines():
        request, answer = json.loads(line)
        came = read_request(connection)
        if came is None or json.loads(came) != json.loads(request):
            return
        send_answer(connection, bytes.fromhex(answer))
    assert read_request(connection) is None


class Walk:
    """A point on a line that answers in JSON.

    Args:
        is_documented: Answer only requests with an ``observation``, as godot_gym_api's
            documentation says; otherwise every request, as its code does.
    """

    def __init__(self, *, is_documented: bool = True) -> None:
        self.requests: list[dict[str, Any]] = []
        self._is_documented = is_documented
        self._place = 0.0

    def __call__(self, request: dict[str, Any]) -> bytes | None:
        self.requests.append(request)
        if "reset" in request:
            self._place = 0.0
        self._place += request.get("action", 0.0)
        if self._is_documented and "observation" not in request:
            return None
        asked = request.get("observation", {})
        parts = {
            "agent": {"place": self._place, "picture": {"$bytes": "AP8K"}},
            "world": {"is_far": self._place > 3.0, "names": ["a", {"b": 1}]},
        }
        answer = {f"{name}_data": part for name, part in parts.items() if name in asked}
        return json.dumps(answer).encode()


def _read(connection: socket.socket, num_bytes: int) -> bytes | None:
    data = b""
    while len(data) < num_bytes:
        piece = connection.recv(num_bytes - len(data))
        if not piece:
            return None
        data += piece
    return data
