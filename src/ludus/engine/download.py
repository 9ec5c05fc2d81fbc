"""Download one file over HTTP and check its SHA-512."""

from __future__ import annotations

import hashlib
import http.client
import socket
import urllib.parse
import urllib.request
from pathlib import Path
from typing import IO

from ludus.engine.installing import InstallerUnavailable, Progress
from ludus.errors import SetupError

__all__ = ["CONNECT_TIMEOUT_S", "download"]

CONNECT_TIMEOUT_S = 5.0
READ_TIMEOUT_S = 30.0

_CHUNK_BYTES = 1 << 20
_MAX_BYTES = 1 << 31


def download(url: str, into: Path, sha512: str, progress: Progress) -> None:
    """Fetch ``url`` into the file ``into``.

    Raises:
        InstallerUnavailable: The server cannot be reached.
        SetupError: The transfer broke off, or the checksum is wrong.
    """
    try:
        response = urllib.request.urlopen(url, timeout=CONNECT_TIMEOUT_S)
    except (OSError, http.client.HTTPException) as error:
        host = urllib.parse.urlsplit(url).netloc
        raise InstallerUnavailable(f"{host} cannot be reached: {error}") from error
    connection = getattr(getattr(response.fp, "raw", None), "_sock", None)
    if isinstance(connection, socket.socket):  # a slow server may take longer between two reads
        connection.settimeout(READ_TIMEOUT_S)
    name = into.name
    with response, into.open("wb") as file:
        try:
            digest = _copy(response, file, name, progress)
        except (TimeoutError, ConnectionError, http.client.HTTPException) as error:
            raise SetupError(f"the download of {url} broke off: {error}", "try again") from error
    if digest != sha512:
        raise SetupError(
            f"{name} is damaged: expected SHA-512 {sha512[:16]}…, got {digest[:16]}…",
            hint="try again; if this repeats, something between here and the server alters "
            "downloads",
        )


def _copy(
    response: http.client.HTTPResponse, file: IO[bytes], name: str, progress: Progress
) -> str:
    total = int(response.headers.get("Content-Length") or 0)
    if total > _MAX_BYTES:
        raise SetupError(f"{name} claims {total} bytes, more than any release has")
    digest = hashlib.sha512()
    done = 0
    while chunk := response.read(_CHUNK_BYTES):
        file.write(chunk)
        digest.update(chunk)
        done += len(chunk)
        if done > _MAX_BYTES:
            raise SetupError(f"{name} has more than {_MAX_BYTES} bytes, more than any release")
        progress(f"download {name}", done / total if total else None)
    if done < total:
        raise http.client.IncompleteRead(b"", total - done)
    return digest.hexdigest()
