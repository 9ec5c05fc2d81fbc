"""The pages say what the code does."""

from __future__ import annotations

import importlib
import importlib.util
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
    *sorted((ROOT / "docs").glob("start/*.md")),
    *sorted((ROOT / "docs").glob("libraries/*.md")),
    *sorted((ROOT / "docs").glob("reference/*.md")),
]


def test_metrics_page_lists_every_metric() -> None:
    page = (ROOT / "docs/metrics.md").read_text()
    rows = dict(re.findall(r"^\| `(\w+)` \| (.*) \|$", page, re.MULTILINE))
    assert rows == {**METRICS, **POLICY_METRICS}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    prose = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    for link in re.findall(r"\]\(([^)#:]+)\)", prose):
        assert (page.parent / link).exists(), link


def test_the_front_page_links_to_every_page() -> None:
    """The site's navigation is made of these links (docs/conf.py)."""
    docs = ROOT / "docs"
    linked = set(re.findall(r"\]\(([^)#:]+\.md)\)", (docs / "index.md").read_text()))
    stand_ins = {"protocol.md", "policy_files.md", "contributing.md", "changelog.md"}
    pages = {page.relative_to(docs).as_posix() for page in PAGES if docs in page.parents}
    assert pages - linked - stand_ins == {"index.md"}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_exist(page: Path) -> None:
    for command in re.findall(r"^ludus (\w+)", page.read_text(), re.MULTILINE):
        assert command in COMMANDS


def _documented_names() -> list[tuple[str, str, str]]:
    """Return every (page, module, name) that a page imports or mentions."""
    found: set[tuple[str, str, str]] = set()
    for page in [*PAGES, *sorted((ROOT / "docs").glob("*.ipynb"))]:
        # The one is of its own time, the others' blocks run where their packages are.
        if page.name == "CHANGELOG.md" or page.parent.name == "libraries":
            continue
        text = page.read_text(encoding="utf-8")
        for module, names in re.findall(r"from (ludus[\w.]*) import ([\w, ]+)", text):
            found |= {(page.name, module, name.strip()) for name in names.split(",")}
        for dotted in re.findall(r"(?<![\w./:\"*-])ludus(?:\.\w+)+(?=[(`:])", text):
            module, _, name = dotted.rpartition(".")
            found.add((page.name, module, name))
    return sorted(found)


@pytest.mark.parametrize(("page", "module", "name"), _documented_names())
def test_documented_names_are_declared(page: str, module: str, name: str) -> None:
    declared = importlib.import_module(module)
    if name not in declared.__all__:  # then it is a module that the page names
        assert importlib.util.find_spec(f"{module}.{name}"), f"{page}: {module}.{name}"


def test_the_package_lists_what_it_exports() -> None:
    assert set(dir(ludus)) == set(ludus.__all__)
