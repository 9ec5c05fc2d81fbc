"""What is missing is named with a command that brings it, wherever Ludus was installed from."""

from __future__ import annotations

import importlib.metadata
import json
from dataclasses import dataclass
from typing import Any

import pytest

from ludus.extras import install_hint


@dataclass
class Installed:
    """The metadata of an installed copy."""

    origin: dict[str, Any] | None
    requires: tuple[str, ...] = (
        "numpy>=2",
        'torch>=2.4; extra == "train"',
        'ludus-rl[cli]; extra == "train"',
        'tyro>=0.9; extra == "cli"',
    )

    def read_text(self, name: str) -> str | None:
        assert name == "direct_url.json"
        return None if self.origin is None else json.dumps(self.origin)


REPOSITORY = {"url": "https://host/ludus.git", "vcs_info": {"vcs": "git", "commit_id": "c0ffee"}}


@pytest.mark.parametrize(
    ("origin", "hint"),
    [
        ({"url": "file:///src/my%20ludus"}, "'/src/my ludus[train]'"),
        ({"url": "https://host/ludus.zip"}, "'ludus-rl[train] @ https://host/ludus.zip'"),
        (REPOSITORY, "'ludus-rl[train] @ git+https://host/ludus.git@c0ffee'"),
        (None, "'torch>=2.4' 'tyro>=0.9'"),
    ],
    ids=["folder", "archive", "repository", "index"],
)
def test_an_extra_comes_from_where_ludus_came_from(
    origin: dict[str, Any] | None, hint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def find(_: str) -> Installed:
        return Installed(origin)

    monkeypatch.setattr(importlib.metadata, "distribution", find)
    assert install_hint("train") == f"pip install {hint}"
