"""Imports go down the floors of docs/architecture.md, and no package is off them."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "ludus"
TOP = {"__init__", "__main__", "_moved"}
"""Modules of the package itself, which may import everything."""


def _floors() -> list[str]:
    """Return the packages of the table, from the top down."""
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\|[^|]*\| (`[^|]+) \|", page, flags=re.MULTILINE)
    return [name for row in rows for name in re.findall(r"`(\w+)`", row) if name != "ludus"]


def _packages() -> set[str]:
    names = {path.stem for path in SOURCE.iterdir() if path.suffix == ".py" or path.is_dir()}
    return names - TOP - {"__pycache__", "py"}


def _imports() -> Iterator[tuple[str, str, str]]:
    """Yield every import between packages: the file, its package, the imported package."""
    for path in SOURCE.rglob("*.py"):
        inside = path.relative_to(SOURCE)
        package = inside.parts[0].removesuffix(".py")
        if package in TOP:
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("ludus."):
                other = str(node.module).split(".")[1]
                if other != package:
                    yield str(inside), package, other


def test_every_package_has_a_floor() -> None:
    assert sorted(_floors()) == sorted(_packages())


def test_imports_go_down() -> None:
    height = {name: index for index, name in enumerate(reversed(_floors()))}
    upward = [
        f"{path} imports ludus.{other}"
        for path, package, other in _imports()
        if height[other] > height[package]
    ]
    assert not upward, "\n".join(upward)
