"""Where exported policies go, and in which format: what ``--to`` means."""

from __future__ import annotations

import difflib
import os
import re
from collections.abc import Collection, Sequence
from pathlib import Path

from ludus.errors import ConfigError

__all__ = ["JSON", "ONNX", "check_place", "format_of", "place_files"]

JSON, ONNX = ".ludus.json", ".onnx"
PLACEHOLDER = "{policy}"


def check_place(to: str) -> None:
    """Refuse a place of no known format.

    Raises:
        ConfigError: It is neither a folder nor ends in ``.ludus.json`` or ``.onnx``.
    """
    if not _is_folder(to):
        format_of(Path(to))


def format_of(path: Path) -> str:
    """Return :data:`JSON` or :data:`ONNX`.

    Raises:
        ConfigError: The name ends otherwise.
    """
    for suffix in (JSON, ONNX):
        if path.name.endswith(suffix) and path.name != suffix:
            return suffix
    wrong = "".join(path.suffixes[-2:])
    close = difflib.get_close_matches(wrong, (JSON, ONNX, ".json"), n=1)
    close = [JSON if close == [".json"] else close[0]] if close else []
    meant = f"did you mean {path.name.removesuffix(wrong)}{close[0]}? " if close else ""
    raise ConfigError(
        f"cannot export to {path}: unknown format",
        f"{meant}end it in {JSON} (for games) or {ONNX}, or in / for a folder",
    )


def place_files(
    policies: Sequence[str], to: str | None, run: Path, others: Collection[str] = ()
) -> list[Path]:
    """Return the file of each policy.

    Args:
        policies: Their names.
        to: A file, if there is one policy; a folder (it exists, or ends in a slash); a pattern
            with ``{policy}``; None is the run's folder.
        run: Folder of the run.
        others: Policies that go into a folder as ``.onnx``, as ``.ludus.json`` cannot hold them.

    Raises:
        ConfigError: The format is unknown, or two policies would share a file.
    """
    if to is None or _is_folder(to):
        folder = run if to is None else Path(to)
        suffixes = [ONNX if name in others else JSON for name in policies]
        patterns = [str(folder / f"{PLACEHOLDER}{suffix}") for suffix in suffixes]
    else:
        patterns = [to] * len(policies)
    paths = [
        Path(pattern.replace(PLACEHOLDER, _as_file_name(name)))
        for pattern, name in zip(patterns, policies, strict=True)
    ]
    for path in paths:
        format_of(path)
    if len(set(paths)) < len(paths):
        raise ConfigError(
            f"{len(paths)} policies ({', '.join(policies)}) cannot all be written to {paths[0]}",
            f"choose one by --policy, or write --to '{PLACEHOLDER}{format_of(paths[0])}'",
        )
    return paths


def _is_folder(to: str) -> bool:
    separators = tuple(filter(None, (os.sep, os.altsep)))
    return to.endswith(separators) or Path(to).is_dir()


def _as_file_name(policy: str) -> str:
    return re.sub(r"[^\w.-]+", "-", policy).strip(".-") or "policy"
