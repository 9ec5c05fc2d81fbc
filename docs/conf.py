"""The documentation site: ``make docs`` builds it from these pages into ``build/docs``."""

from __future__ import annotations

import os
import re
import shutil
import sys
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.util import logging

from ludus.version import __version__

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

from _links import broken_links  # noqa: E402
from _reference import write_command_pages, write_error_pages, write_gdscript_pages  # noqa: E402

project = "Ludus"
author = project_copyright = "the Ludus developers"
release = version = __version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["_*"]
# Blocks with an ellipsis for what is left out are coloured as far as they can be read.
suppress_warnings = ["misc.highlighting_failure"]

html_theme = "furo"
html_title = f"Ludus {__version__}"
html_copy_source = False
html_static_path = ["_static"]
html_css_files = ["ludus.css"]
html_favicon = "../engines/godot4/addons/ludus/icons/ludus_agent.svg"

myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3

# Attributes that a docstring lists stay one description, beside those of the members.
napoleon_use_ivar = True
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True, "show-inheritance": True}
# Packages of other libraries, which `make docs` does not install.
autodoc_mock_imports = ["pettingzoo", "ray", "stable_baselines3"]

# What `make lint` writes when there is Cargo; the page about Rust links to it.
RUSTDOC = Path(os.environ.get("CARGO_TARGET_DIR", HERE.parent / "engines/bevy/target")) / "doc"
RUST_CRATES = ("bevy_ludus", "bevy_ludus_rest")

# What `make web` writes: a trained agent that plays in the browser, in place of the film of one.
WEB_GAME = HERE.parent / "build" / "web"
PLAYABLE = """\
<iframe src="play/index.html" class="play" title="A trained agent balances a pole"></iframe>

*The agent plays in your browser: the Bevy example, compiled to WebAssembly with its policy.*
"""

OUTSIDE = {
    "protocol": "protocol/PROTOCOL.md",
    "policy_files": "protocol/POLICY.md",
    "changelog": "CHANGELOG.md",
    "contributing": "CONTRIBUTING.md",
    "index": "README.md",
}
"""Pages of the site, and the files outside this folder that GitHub shows in their place."""


def _read_page(_app: Sphinx, page: str, source: list[str]) -> None:
    """Make a page that reads well on GitHub one of the site.

    Links to files outside this folder lead to their pages in the site, or become plain text;
    languages of code blocks lose what only rustdoc understands.
    """
    folder = (HERE / page).parent
    if page in OUTSIDE and page != "index":
        file = HERE.parent / OUTSIDE[page]
        source[0], folder = file.read_text(encoding="utf-8"), file.parent
    pages = {(HERE.parent / file).resolve(): name for name, file in OUTSIDE.items()}

    def lead(link: re.Match[str]) -> str:
        path, anchor = link[2], link[3] or ""
        target = (folder / path).resolve()
        if target in pages:
            # The front page of the site is not the README, and has none of its headings.
            return f"[{link[1]}](/{pages[target]}.md{'' if pages[target] == 'index' else anchor})"
        if target.is_relative_to(HERE):
            return f"[{link[1]}](/{target.relative_to(HERE).as_posix()}{anchor})"
        return link[1]

    if not folder.is_relative_to(HERE) or "](../" in source[0]:
        source[0] = re.sub(r"\[([^\]]*)\]\(([\w./-]+)(#[\w-]+)?\)", lead, source[0])
    source[0] = re.sub(r"^```rust,\w+$", "```rust", source[0], flags=re.MULTILINE)
    if page == "reference/rust" and _has_rustdoc():
        source[0] += "\nThis site holds it, too: " + " and ".join(
            f'<a href="../rust/{crate}/index.html">{crate}</a>' for crate in RUST_CRATES
        )
    if page == "index" and WEB_GAME.exists():
        source[0] = re.sub(r"^!\[.*\n", PLAYABLE, source[0], count=1, flags=re.MULTILINE)
    if page == "index":
        source[0] += _navigation(source[0])


def _navigation(front_page: str) -> str:
    """Return a hidden toctree for each section of the front page, of the pages it links to.

    So the map that GitHub shows is also the site's navigation.
    """
    toctrees = ""
    for heading, section in re.findall(r"^## (.+)\n((?:(?!## ).*\n)*)", front_page, re.MULTILINE):
        links: list[tuple[str, str]] = re.findall(r"\[([^\]]+)\]\(([\w/-]+)\.md\)", section)
        pages = "\n".join(f"{text} <{page}>" for text, page in links)
        toctrees += (
            f'\n```{{toctree}}\n:caption: "{heading}"\n:hidden:\n:maxdepth: 1\n\n{pages}\n```\n'
        )
    return toctrees


def _link_pages(
    _app: Sphinx, _what: str, _name: str, _object: object, _options: object, lines: list[str]
) -> None:
    """Make links of the pages that a docstring names: ``docs/targets.md``, ``PROTOCOL.md``."""
    front_page = (HERE / "index.md").read_text(encoding="utf-8")
    titles = {
        (HERE / path).resolve(): text
        for text, path in re.findall(r"\[([^\]]+)\]\(([\w./-]+\.md)\)", front_page)
    }
    stand_ins = {(HERE.parent / file).resolve(): page for page, file in OUTSIDE.items()}

    def link(found: re.Match[str]) -> str:
        file = HERE.parent / (found[1] or "protocol/") / found[2]
        title = titles.get(file)
        return f":doc:`{title} </{stand_ins.get(file, file.stem)}>`" if title else found[0]

    pattern = r"(?<![\w/`])(?:``)?(docs/|protocol/)?([\w-]+\.md)(?:``)?(?![\w`])"
    lines[:] = [re.sub(pattern, link, line) for line in lines]


def _generate(_app: Sphinx) -> None:
    write_command_pages(HERE / "reference" / "commands")
    write_error_pages(HERE / "reference" / "errors")
    write_gdscript_pages(HERE / "reference" / "gdscript")


def _has_rustdoc() -> bool:
    return all((RUSTDOC / crate / "index.html").exists() for crate in RUST_CRATES)


def _add_rustdoc(app: Sphinx, error: Exception | None) -> None:
    """Copy what Cargo wrote into the site, without the pages of source code."""
    if error is None and _has_rustdoc():
        for part in (*RUST_CRATES, "static.files"):
            shutil.copytree(RUSTDOC / part, Path(app.outdir) / "rust" / part, dirs_exist_ok=True)


def _add_web_game(app: Sphinx, error: Exception | None) -> None:
    if error is None and WEB_GAME.exists():
        shutil.copytree(WEB_GAME, Path(app.outdir) / "play", dirs_exist_ok=True)


def _check_links(app: Sphinx, error: Exception | None) -> None:
    if error is None and app.builder.format == "html":
        for link in broken_links(Path(app.outdir)):
            logging.getLogger(__name__).warning("broken link in %s", link)


def setup(app: Sphinx) -> None:
    """Generate the reference before pages are read."""
    app.connect("builder-inited", _generate)
    app.connect("source-read", _read_page)
    app.connect("autodoc-process-docstring", _link_pages)
    app.connect("build-finished", _add_rustdoc)
    app.connect("build-finished", _add_web_game)
    app.connect("build-finished", _check_links)
