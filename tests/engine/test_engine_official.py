"""Route 4: official archives, from a local server that misbehaves on request."""

from __future__ import annotations

import hashlib
import http.server
import io
import stat
import threading
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from ludus.engine.archive import unpack_zip
from ludus.engine.install import install_engine
from ludus.engine.kinds import EngineKind
from ludus.engine.official import ASSETS, Asset, OfficialRoute
from ludus.engine.routes import RouteUnavailable
from ludus.errors import SetupError

PROGRAM = b"#!/bin/sh\necho 4.6.3.stable.official\n"


def ignore(_what: str, _fraction: float | None) -> None:
    """Take note of no progress."""


def make_zip(name: str = "godot", mode: int = 0o755) -> bytes:
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        entry = zipfile.ZipInfo(name)
        entry.external_attr = mode << 16
        archive.writestr(entry, PROGRAM)
    return data.getvalue()


class Server(http.server.ThreadingHTTPServer):
    """Serves one body, and claims ``extra_bytes`` more than it sends."""

    body = b""
    extra_bytes = 0


class Handler(http.server.BaseHTTPRequestHandler):
    def do_GET(self) -> None:
        assert isinstance(self.server, Server)
        if not self.path.endswith("/tag/godot.zip"):
            self.send_error(404)
            return
        self.send_response(200)
        self.send_header("Content-Length", str(len(self.server.body) + self.server.extra_bytes))
        self.end_headers()
        self.wfile.write(self.server.body)

    def log_message(self, format: str, *args: object) -> None:
        pass


@pytest.fixture
def server() -> Iterator[Server]:
    with Server(("127.0.0.1", 0), Handler) as running:
        thread = threading.Thread(target=running.serve_forever, args=(0.02,))
        thread.start()
        yield running
        running.shutdown()
        thread.join()


def route_to(server: Server, body: bytes, tag: str = "tag") -> OfficialRoute:
    sha512 = hashlib.sha512(body).hexdigest()
    asset = Asset(tag, "godot.zip", "godot", sha512)
    return OfficialRoute(base_url=f"http://127.0.0.1:{server.server_port}", assets=(asset,))


def test_archive_is_installed(server: Server, bare_machine: Path) -> None:
    server.body = make_zip(mode=0)
    fractions: list[float | None] = []
    engine = install_engine(
        EngineKind.GODOT4,
        routes=[route_to(server, server.body)],
        progress=lambda _what, fraction: fractions.append(fraction),
    )
    assert engine.version_text == "4.6.3.stable.official"
    assert sorted(file.name for file in engine.path.parent.iterdir()) == ["engine.json", "godot"]
    assert fractions == [1.0, None]


@pytest.mark.parametrize("fault", ["truncated", "altered", "not a zip"])
def test_bad_download_installs_nothing(fault: str, server: Server, bare_machine: Path) -> None:
    server.body = body = make_zip() if fault != "not a zip" else b"<html>sign in first</html>"
    route = route_to(server, body)
    if fault == "truncated":
        server.body, server.extra_bytes = body[:-20], 20
    elif fault == "altered":
        server.body = body.replace(b"echo", b"evil")
    with pytest.raises(SetupError) as caught:
        install_engine(EngineKind.GODOT4, routes=[route])
    expected = {"truncated": "broke off", "altered": "SHA-512", "not a zip": "sound zip"}
    assert expected[fault] in caught.value.message


def test_missing_release_and_dead_server_are_reasons_to_go_on(
    server: Server, tmp_path: Path
) -> None:
    routes = [route_to(server, b"", tag="other"), OfficialRoute(base_url="http://127.0.0.1:9")]
    for route in routes:
        with pytest.raises(RouteUnavailable, match="cannot be reached"):
            route.unpack(EngineKind.GODOT4, tmp_path, rendering=False, progress=ignore)


def test_unknown_platform_is_a_reason_to_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("platform.machine", lambda: "vax")
    with pytest.raises(RouteUnavailable, match="vax"):
        OfficialRoute().unpack(EngineKind.GODOT4, tmp_path, rendering=False, progress=ignore)


@pytest.mark.parametrize("name", ["../evil", "/evil", "a/../../evil", "C:/evil", "..\\evil"])
def test_archive_cannot_leave_its_folder(name: str, tmp_path: Path) -> None:
    archive, folder = tmp_path / "a.zip", tmp_path / "inside"
    archive.write_bytes(make_zip(name))
    with pytest.raises(SetupError, match="leaves its folder"):
        unpack_zip(archive, folder)
    assert not (tmp_path / "evil").exists()


def test_links_in_archives_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.zip").write_bytes(make_zip(mode=stat.S_IFLNK | 0o777))
    with pytest.raises(SetupError, match="leaves its folder"):
        unpack_zip(tmp_path / "a.zip", tmp_path / "inside")


def test_table_of_archives_is_well_formed() -> None:
    assets = [asset for entry in ASSETS.values() for asset in entry]
    assert {kind for kind, _ in ASSETS} == set(EngineKind)
    assert len({asset.sha512 for asset in assets}) == len(assets)
    assert len({asset.file_name for asset in assets}) == len(assets)
    for asset in assets:
        assert len(bytes.fromhex(asset.sha512)) == 64
        assert asset.file_name.startswith(f"Godot_v{asset.tag}_")
