"""The token of this user (docs/security.md): where it lies, and which file is none."""

from __future__ import annotations

import os
import stat
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from ludus.errors import SetupError
from ludus.session.user_token import user_token, user_token_path

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="XDG_CACHE_HOME is Linux's")


@pytest.fixture
def path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert user_token_path() == tmp_path / "ludus" / "token"
    return user_token_path()


def test_it_is_made_once_and_only_its_user_may_read_it(path: Path) -> None:
    token = user_token()
    assert len(token) == 64
    assert user_token() == token == path.read_text().strip()
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert [file.name for file in path.parent.iterdir()] == ["token"]


def test_all_who_make_it_at_the_same_time_get_the_same(path: Path) -> None:
    with ThreadPoolExecutor(16) as threads:
        calls = [threads.submit(user_token) for _ in range(64)]
    tokens = {call.result() for call in calls}
    assert tokens == {path.read_text().strip()}
    assert [file.name for file in path.parent.iterdir()] == ["token"]


@pytest.mark.parametrize("mode", [0o644, 0o660, 0o604, 0o606])
def test_a_file_that_others_may_use_is_refused(path: Path, mode: int) -> None:
    user_token()
    path.chmod(mode)
    with pytest.raises(SetupError, match="not yours alone") as caught:
        user_token()
    assert "delete it" in caught.value.hint


@pytest.mark.skipif(os.name != "posix" or os.geteuid() != 0, reason="only root gives files away")
def test_a_file_of_another_user_is_refused(path: Path) -> None:
    user_token()
    os.chown(path, 65534, 65534)
    with pytest.raises(SetupError, match="not yours alone"):
        user_token()


@pytest.mark.parametrize("kind", ["link", "folder", "pipe", "empty"])
def test_what_is_no_file_with_a_token_is_an_error(path: Path, tmp_path: Path, kind: str) -> None:
    path.parent.mkdir()
    if kind == "link":
        (tmp_path / "elsewhere").write_text("a token of somebody else")
        path.symlink_to(tmp_path / "elsewhere")
    elif kind == "folder":
        path.mkdir(mode=0o700)
    elif kind == "pipe":
        os.mkfifo(path, 0o600)
    else:
        path.touch(0o600)
    with pytest.raises(SetupError, match=str(path)):
        user_token()
