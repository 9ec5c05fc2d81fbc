"""The pages say what the code does."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import ludus
from ludus.cli.main import COMMANDS
from ludus.runs.metrics import METRICS, POLICY_METRICS

ROOT = Path(__file__).parents[2]
PAGES = [
    ROOT / "README.md",
    ROOT / "CHANGELOG.md",
    ROOT / "CONTRIBUTING.md",
    *sorted((ROOT / "docs").glob("*.md")),
]


def test_metrics_page_lists_every_metric() -> None:
    page = (ROOT / "docs/metrics.md").read_text()
    rows = dict(re.findall(r"^\| `(\w+)` \| (.*) \|$", page, re.MULTILINE))
    assert rows == {**METRICS, **POLICY_METRICS}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    for link in re.findall(r"\]\(([^)#:]+)\)", page.read_text()):
        assert (page.parent / link).exists(), link


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_exist(page: Path) -> None:
    for command in re.findall(r"^ludus (\w+)", page.read_text(), re.MULTILINE):
        assert command in COMMANDS


def test_public_names_exist() -> None:
    for name in ludus.__all__:
        assert getattr(ludus, name) is not None
    assert set(dir(ludus)) == set(ludus.__all__)
