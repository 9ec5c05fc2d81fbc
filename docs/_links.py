"""Checks that every link inside a built site leads to a page, and every anchor to a heading.

Sphinx itself does not look into links that pages write as HTML.
"""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit


class _Page(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.anchors: set[str] = {""}
        self.links: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        attributes = {name: value or "" for name, value in attrs}
        self.anchors |= {attributes[name] for name in ("id", "name") if name in attributes}
        link = attributes.get("href" if tag in ("a", "link") else "src")
        if link is not None:
            self.links.add(link)


def broken_links(site: Path) -> list[str]:
    """Return ``PAGE: LINK`` for each link inside the site that leads nowhere.

    Rustdoc's pages are targets only: Cargo checks their own links.
    """
    pages: dict[Path, _Page] = {}
    for file in site.rglob("*.html"):
        pages[file.resolve()] = page = _Page()
        page.feed(file.read_text(encoding="utf-8"))
    broken: list[str] = []
    for file, page in pages.items():
        if (site / "rust").resolve() in file.parents:
            continue
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (file.parent / unquote(parts.path)).resolve() if parts.path else file
            target_page = pages.get(target)
            anchor = unquote(parts.fragment)
            if not target.exists() or (target_page and anchor not in target_page.anchors):
                broken.append(f"{file.relative_to(site.resolve())}: {link}")
    return sorted(broken)
