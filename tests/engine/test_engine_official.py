"""Official archives, from a local server that misbehaves on request."""

from __future__ import annotations

import hashlib
import http.server
import io
import stat
import threading
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from ludus.engine.archive import unpack_zip
from ludus.engine.find import InstalledEngine
from ludus.engine.install import install_engine, install_template
from ludus.engine.installing import InstallerUnavailable
from ludus.engine.kinds import EngineKind
from ludus.engine.official import (
    Archive,
    OfficialInstaller,
    official_engine,
    official_template,
    read_releases,
)
from ludus.engine.template import matching_template
from ludus.errors import SetupError

PROGRAM = b"#!/bin/sh\necho 4.6.3.stable.official\n"


def ignore(_what: str, _fraction: float | None) -> None:
    """Take note of no progress."""


def make_zip(*names: str, mode: int = 0o755) -> bytes:
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        for name in names or ("godot",):
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
        if not self.path.endswith(("/tag/godot.zip", "/4.6.3-stable/t.tpz")):
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


def installer_from(server: Server, body: bytes, tag: str = "tag") -> OfficialInstaller:
    archive = Archive(tag, "godot.zip", "godot", hashlib.sha512(body).hexdigest())
    return OfficialInstaller((archive,), base_url=f"http://127.0.0.1:{server.server_port}")


def test_archive_is_installed(server: Server, bare_machine: Path) -> None:
    server.body = make_zip(mode=0)
    fractions: list[float | None] = []
    engine = install_engine(
        EngineKind.GODOT4,
        installers=[installer_from(server, server.body)],
        progress=lambda _what, fraction: fractions.append(fraction),
    )
    assert engine.version_text == "4.6.3.stable.official"
    assert sorted(file.name for file in engine.path.parent.iterdir()) == ["engine.json", "godot"]
    assert fractions == [1.0, None]


@pytest.mark.parametrize("fault", ["truncated", "altered", "not a zip"])
def test_bad_download_installs_nothing(fault: str, server: Server, bare_machine: Path) -> None:
    server.body = body = make_zip() if fault != "not a zip" else b"<html>sign in first</html>"
    installer = installer_from(server, body)
    if fault == "truncated":
        server.body, server.extra_bytes = body[:-20], 20
    elif fault == "altered":
        server.body = body.replace(b"echo", b"evil")
    with pytest.raises(SetupError) as caught:
        install_engine(EngineKind.GODOT4, installers=[installer])
    expected = {"truncated": "broke off", "altered": "SHA-512", "not a zip": "valid zip"}
    assert expected[fault] in caught.value.message


def test_missing_release_and_dead_server_are_reasons_to_go_on(
    server: Server, tmp_path: Path
) -> None:
    dead = replace(installer_from(server, b""), base_url="http://127.0.0.1:9")
    for installer in (installer_from(server, b"", tag="other"), dead):
        with pytest.raises(InstallerUnavailable, match="cannot be reached"):
            installer.unpack(tmp_path, ignore)


def test_unknown_platform_is_a_reason_to_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("platform.machine", lambda: "vax")
    with pytest.raises(InstallerUnavailable, match="vax"):
        official_engine(EngineKind.GODOT4, rendering=False).unpack(tmp_path, ignore)


@pytest.mark.parametrize("name", ["../evil", "/evil", "a/../../evil", "C:/evil", "..\\evil"])
def test_archive_cannot_leave_its_folder(name: str, tmp_path: Path) -> None:
    archive, folder = tmp_path / "a.zip", tmp_path / "inside"
    archive.write_bytes(make_zip(name))
    with pytest.raises(SetupError, match="outside its folder"):
        unpack_zip(archive, folder)
    assert not (tmp_path / "evil").exists()


def test_links_in_archives_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.zip").write_bytes(make_zip(mode=stat.S_IFLNK | 0o777))
    with pytest.raises(SetupError, match="outside its folder"):
        unpack_zip(tmp_path / "a.zip", tmp_path / "inside")


TEMPLATE_NAMES = ("templates/version.txt", "templates/linux_release.x86_64", "templates/web.zip")
ENGINE = InstalledEngine(EngineKind.GODOT4, Path("/godot"), (4, 6, 3), "4.6.3.stable.x", "PATH")


def template_installer_from(server: Server, body: bytes) -> OfficialInstaller:
    server.body = body
    (archive,) = read_releases("template")[EngineKind.GODOT4, "linux-x86_64"]
    archive = replace(archive, file_name="t.tpz", sha512=hashlib.sha512(body).hexdigest())
    base_url = f"http://127.0.0.1:{server.server_port}"
    return OfficialInstaller((archive,), "4.6.3.stable", base_url)


def test_of_the_templates_only_the_one_for_linux_is_kept(
    server: Server, bare_machine: Path
) -> None:
    installer = template_installer_from(server, make_zip(*TEMPLATE_NAMES, mode=0))
    template = install_template(ENGINE, installers=[installer])
    assert (template.version_text, template.prefix) == ("4.6.3.stable.official", None)
    folder = template.path.parent.parent
    files = sorted(str(file.relative_to(folder)) for file in folder.rglob("*") if file.is_file())
    assert files == ["template.json", "templates/linux_release.x86_64"]


def test_damaged_templates_install_nothing(server: Server, bare_machine: Path) -> None:
    body = make_zip(*TEMPLATE_NAMES)
    installer = template_installer_from(server, body)
    server.body = body.replace(b"echo", b"evil")
    with pytest.raises(SetupError, match="SHA-512"):
        install_template(ENGINE, installers=[installer])
    with pytest.raises(SetupError, match=r"not contain templates/linux_release\.x86_64"):
        install_template(ENGINE, installers=[template_installer_from(server, make_zip("other"))])
    assert matching_template(ENGINE) is None


def test_templates_of_another_release_are_not_downloaded(tmp_path: Path) -> None:
    with pytest.raises(InstallerUnavailable, match=r"has 4\.6\.3-stable, expected 4\.5\.stable"):
        official_template("4.5.stable").unpack(tmp_path, ignore)


def test_templates_for_unknown_platforms_are_a_reason_to_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("platform.machine", lambda: "vax")
    with pytest.raises(InstallerUnavailable, match="vax"):
        official_template("4.6.3.stable").unpack(tmp_path, ignore)


def test_table_of_archives_is_well_formed() -> None:
    engines = read_releases("engine")
    archives = [archive for entry in engines.values() for archive in entry]
    assert {kind for kind, _ in engines} == set(EngineKind)
    assert len({archive.sha512 for archive in archives}) == len(archives)
    assert len({archive.file_name for archive in archives}) == len(archives)
    for archive in archives:
        assert len(bytes.fromhex(archive.sha512)) == 64
        assert archive.file_name.startswith(f"Godot_v{archive.tag}_")
    for (_, platform), (archive,) in read_releases("template").items():
        assert len(bytes.fromhex(archive.sha512)) == 64
        assert archive.file_name == f"Godot_v{archive.tag}_export_templates.tpz"
        assert archive.executable.endswith(platform.removeprefix("linux-"))
