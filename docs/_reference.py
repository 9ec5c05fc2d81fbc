"""Reference pages that are made from the code whenever the site is built.

Commands come from their own ``--help``, and GDScript classes from Godot's ``--doctool``, so that
neither can say anything else than the code.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from ludus.cli.main import COMMANDS, main
from ludus.engine import EngineKind, find_engine

ADDON = Path(__file__).parents[1] / "engines" / "godot4"


def write_command_pages(folder: Path) -> None:
    """Write one page for each command, with its help and that of its subcommands."""
    _make_empty(folder)
    for name, (_, summary) in COMMANDS.items():
        text = _help(name)
        page = [f"# ludus {name}", "", f"{summary.capitalize()}.", "", *_literal(text)]
        for subcommand in _subcommands(text):
            page += ["", f"## ludus {name} {subcommand}", "", *_literal(_help(name, subcommand))]
        (folder / f"{name}.md").write_text("\n".join(page) + "\n", encoding="utf-8")


def write_gdscript_pages(folder: Path) -> None:
    """Write one page for each global class of the Godot 4 add-on.

    Raises:
        EngineNotFound: There is no Godot 4.
    """
    _make_empty(folder)
    with tempfile.TemporaryDirectory(prefix="ludus-docs-") as temporary:
        project, xml, pages = (Path(temporary) / name for name in ("project", "xml", "pages"))
        shutil.copytree(ADDON / "addons", project / "addons")
        (project / "project.godot").write_text("config_version=5\n")
        xml.mkdir()
        godot = [str(find_engine(EngineKind.GODOT4).path), "--headless", "--path", str(project)]
        # Without an import Godot knows no global class, and documents none.
        _run([*godot, "--import"])
        _run([*godot, "--doctool", str(xml), "--no-docbase", "--gdscript-docs", "res://addons"])
        _run([str(Path(sys.executable).with_name("c3-godot-docs-gen")), str(xml), str(pages)])
        written = {page.name: page.read_text("utf-8") for page in pages.glob("Ludus*.md")}
    for name, text in written.items():
        (folder / name).write_text(_site_links(text, set(written)), encoding="utf-8")


def _site_links(page: str, pages: set[str]) -> str:
    """Make links of a generated page work in the site.

    MyST does not see anchors written in HTML, so links to them become HTML, too. Links to classes
    that have no page become text.
    """

    def link(found: re.Match[str]) -> str:
        text, file, anchor = found[1], found[2], found[3]
        if file and file not in pages:
            return text
        if not anchor:
            return found[0]
        shown = re.sub(r"`([^`]*)`", r"<code>\1</code>", text)
        return f'<a href="{file.replace(".md", ".html")}{anchor}">{shown}</a>'

    page = re.sub(r"\[([^\[\]]*)\]\(([\w.]*)(#[\w-]+)?\)", link, page)
    return re.sub(r'href="([\w]+)\.md', r'href="\1.html', page)


def _help(*command: str) -> str:
    """Return what ``ludus COMMAND --help`` prints, as in a terminal of 88 columns."""
    output = io.StringIO()
    with _plain_terminal(), contextlib.redirect_stdout(output):
        main([*command, "--help"])
    return output.getvalue().strip()


@contextlib.contextmanager
def _plain_terminal() -> Iterator[None]:
    before = dict(os.environ)
    os.environ.update(COLUMNS="88", NO_COLOR="1", TERM="dumb")
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


def _subcommands(help_: str) -> list[str]:
    usage = help_.split("\n\n", maxsplit=1)[0]
    found = re.search(r"\{([a-z,-]+)\}", usage)
    return found[1].split(",") if found else []


def _literal(text: str) -> list[str]:
    return ["```text", text, "```"]


def _run(command: list[str]) -> None:
    subprocess.run(command, check=True, capture_output=True, timeout=120)


def _make_empty(folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
