"""A web page may not play: shown with a real Chromium, where there is one."""

from __future__ import annotations

import http.client
import os
import shutil
import signal
import subprocess
import threading
import time
import urllib.request
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from gymnasium import spaces

from ludus.engine.bevy_build import build_bevy_example
from tests.legacy.bevy_rl.program import Program

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")

pytestmark = [
    pytest.mark.engine,
    pytest.mark.bevy,
    pytest.mark.timeout(300, func_only=True),
    pytest.mark.skipif(CHROMIUM is None, reason="no Chromium; apt-get install chromium"),
]

_DEADLINE_S = 90.0
_SETTINGS: dict[str, Any] = {
    "action_space": spaces.Discrete(2),
    "observation_space": spaces.Box(-1e9, 1e9, (4,)),
}
_STEP = "/step?payload=%5B%7B%22action%22:%221%22%7D%5D"

# What the page does, and the first request of it.
PAGES = {
    "img": (f'<img src="{{game}}{_STEP}">', f"GET {_STEP}"),
    "fetch": ('<script>fetch("{game}/reset", {{mode: "no-cors"}})</script>', "GET /reset"),
    "form": (
        '<form method="post" action="{game}/reset"></form><script>document.forms[0].submit()'
        "</script>",
        "POST /reset",
    ),
    "link": (
        '<a href="{game}/reset">prize</a><script>document.links[0].click()</script>',
        "GET /reset",
    ),
    "frame": ('<iframe src="{game}/reset"></iframe>', "GET /reset"),
}


class _Server(ThreadingHTTPServer):
    """Serves the pages of a stranger, or passes requests on to the game and notes its answers."""

    daemon_threads = True

    def __init__(self, game: str = "") -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.game = urlsplit(game).netloc
        self.page = b""
        self.answers: list[tuple[str, int]] = []
        threading.Thread(target=self.serve_forever, daemon=True).start()


class _Handler(BaseHTTPRequestHandler):
    def log_message(self, format: str, *args: Any) -> None: ...

    def do_GET(self) -> None:
        server = self.server
        assert isinstance(server, _Server)
        if not server.game:
            self._answer(200, server.page)
            return
        connection = http.client.HTTPConnection(server.game, timeout=30)
        # Under its own name, as if the browser had asked the game itself.
        headers = {**dict(self.headers.items()), "Connection": "close"}
        body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        connection.request(self.command, self.path, body, headers)
        response = connection.getresponse()
        if self.path != "/favicon.ico":
            server.answers.append((f"{self.command} {self.path}", response.status))
        self._answer(response.status, response.read())
        connection.close()

    do_POST = do_GET  # noqa: N815

    def _answer(self, status: int, body: bytes) -> None:
        self.send_response(status)
        self.send_header("Content-Type", "text/html")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)


@pytest.fixture(scope="module")
def game() -> Iterator[_Server]:
    """A real game that has been played for a step, behind a witness."""
    program = Program(build_bevy_example("rest_cartpole"), "--port=0", defaults=_SETTINGS)
    server = _Server(program.url)
    _ask(server, "/reset")
    _ask(server, _STEP)
    yield server
    server.shutdown()
    server.server_close()
    program.close()


@pytest.fixture
def stranger() -> Iterator[_Server]:
    server = _Server()
    yield server
    server.shutdown()
    server.server_close()


def _ask(server: _Server, path: str) -> bytes:
    with urllib.request.urlopen(f"http://{server.game}{path}", timeout=30) as response:
        return response.read()


def _visit(url: str, game: _Server, profile: Path) -> list[tuple[str, int]]:
    """Open a page until the game has answered; return what was asked, and the status."""
    game.answers.clear()
    process = subprocess.Popen(
        [
            str(CHROMIUM), "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run",
            "--disable-background-networking", f"--user-data-dir={profile}",
            "--host-resolver-rules=MAP evil.example 127.0.0.1",
            "--remote-debugging-port=0", url,
        ],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
    )  # fmt: skip
    try:
        deadline = time.monotonic() + _DEADLINE_S
        while not game.answers and time.monotonic() < deadline:
            assert process.poll() is None, "Chromium has ended"
            time.sleep(0.05)
        return list(game.answers)
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


@pytest.mark.parametrize("kind", PAGES)
def test_a_page_of_a_stranger_is_refused(
    kind: str, game: _Server, stranger: _Server, tmp_path: Path
) -> None:
    before = _ask(game, "/state")
    page, request = PAGES[kind]
    stranger.page = page.format(game=f"http://127.0.0.1:{game.server_port}").encode()
    answers = _visit(f"http://evil.example:{stranger.server_port}/", game, tmp_path)
    assert answers == [(request, 403)]
    assert _ask(game, "/state") == before


def test_a_name_that_was_pointed_here_is_refused(game: _Server, tmp_path: Path) -> None:
    before = _ask(game, "/state")
    answers = _visit(f"http://evil.example:{game.server_port}/reset", game, tmp_path)
    assert answers == [("GET /reset", 403)]
    assert _ask(game, "/state") == before


def test_a_person_who_types_the_address_plays(game: _Server, tmp_path: Path) -> None:
    before = _ask(game, "/state")
    answers = _visit(f"http://127.0.0.1:{game.server_port}/reset", game, tmp_path)
    assert answers == [("GET /reset", 200)]
    assert _ask(game, "/state") != before
