"""Find an installed engine: the one the user names, then ``PATH``, then the user cache."""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass, field
from pathlib import Path

from ludus.engine.cache import EngineRecord, cache_root, cached_engines
from ludus.engine.kinds import EngineKind, Version
from ludus.engine.version import ask_version
from ludus.errors import ConfigError, EngineNotFound

__all__ = [
    "EngineSearch",
    "InstalledEngine",
    "find_engine",
    "list_engines",
    "search_engines",
]


@dataclass(frozen=True)
class InstalledEngine:
    """An engine that answered with a version Ludus supports.

    Attributes:
        kind: Which engine.
        path: Executable that runs without a window.
        version: Numbers of the version, such as ``(4, 6, 3)``.
        version_text: What the engine calls itself.
        source: Where it was found: ``--godot``, ``$LUDUS_GODOT``, ``PATH`` or ``cache …``.
        window_path: Executable that opens a window, where that is another one (Godot 3 on
            Linux).
    """

    kind: EngineKind
    path: Path
    version: Version
    version_text: str
    source: str
    window_path: Path | None = None

    @classmethod
    def from_cache(cls, kind: EngineKind, folder: Path, record: EngineRecord) -> InstalledEngine:
        """Describe an engine in the user cache."""
        rendering = ", rendering" if record.has_rendering else ""
        return cls(
            kind=kind,
            path=folder / record.executable,
            version=record.version,
            version_text=record.version_text,
            source=f"cache ({record.route}{rendering})",
            window_path=folder / record.window_executable,
        )

    def executable(self, *, headless: bool) -> Path:
        """Return the executable to start."""
        return self.path if headless or self.window_path is None else self.window_path

    @property
    def opens_window(self) -> bool:
        """Whether it opens a window even if asked not to: a Godot 3 that is not a server build."""
        is_server = self.window_path is not None or "server" in self.path.name
        return self.kind is EngineKind.GODOT3 and not is_server


@dataclass
class EngineSearch:
    """The result of a search.

    Attributes:
        kind: Engine that was searched for.
        found: Usable engines, in the order of preference.
        notes: One line per place that has no usable engine, with the reason.
    """

    kind: EngineKind
    found: list[InstalledEngine] = field(default_factory=list[InstalledEngine])
    notes: list[str] = field(default_factory=list[str])


def find_engine(kind: EngineKind, explicit: Path | str | None = None) -> InstalledEngine:
    """Find the engine to use.

    Args:
        kind: Which engine.
        explicit: What the user named (``--godot``). It is used or refused, never skipped; the
            same holds for the environment variable.

    Raises:
        ConfigError: The executable that the user named is missing or unsuitable.
        EngineNotFound: There is no usable engine; the text lists every place searched.
    """
    named = _named_by_user(kind, explicit)
    if named is not None:
        return _accept_named(kind, *named)
    search = EngineSearch(kind)
    _search_path(search)
    if not search.found:
        _search_cache(search)
    if not search.found:
        notes = [f"${kind.traits.environment_variable}: not set", *search.notes]
        raise EngineNotFound(
            "\n  ".join([f"no {kind.traits.label} was found; searched:", *notes]),
            hint=f"ludus engine install {kind}",
        )
    return search.found[0]


def search_engines(kind: EngineKind) -> EngineSearch:
    """Search every place for one kind of engine; never raises."""
    search = EngineSearch(kind)
    named = _named_by_user(kind, None)
    if named is not None:
        try:
            search.found.append(_accept_named(kind, *named))
        except ConfigError as error:
            search.notes.append(error.message)
    _search_path(search)
    _search_cache(search)
    return search


def list_engines() -> list[InstalledEngine]:
    """List every usable engine of every kind, in the order of preference."""
    return [engine for kind in EngineKind for engine in search_engines(kind).found]


def _named_by_user(kind: EngineKind, explicit: Path | str | None) -> tuple[Path, str] | None:
    if explicit is not None:
        return Path(explicit), "--godot"
    variable = kind.traits.environment_variable
    value = os.environ.get(variable)
    return (Path(value), f"${variable}") if value else None


def _accept_named(kind: EngineKind, path: Path, source: str) -> InstalledEngine:
    path = path.expanduser()
    inside_app_bundle = path / "Contents" / "MacOS" / "Godot"
    if path.suffix == ".app" and inside_app_bundle.is_file():
        path = inside_app_bundle
    if not path.is_file():
        found = "is not a file"
    elif not os.access(path, os.X_OK):
        found = "is not executable"
    else:
        found = _examine(kind, path.absolute(), source)
    if isinstance(found, InstalledEngine):
        return found
    hint = f"correct {source}, or leave it out to use an engine from PATH or the cache"
    raise ConfigError(f"{source} names {path}, which {found}", hint)


def _examine(kind: EngineKind, path: Path, source: str) -> InstalledEngine | str:
    """Ask an executable for its version; return the engine, or what is wrong with it."""
    answer = ask_version(path)
    if answer is None:
        return "does not answer --version"
    if not kind.accepts(answer[0]):
        return f"is {answer[1]}; {kind.traits.requirement}"
    return InstalledEngine(kind, path, *answer, source)


def _search_path(search: EngineSearch) -> None:
    for name in search.kind.traits.path_names:
        location = shutil.which(name)
        if location is None:
            search.notes.append(f"PATH: no {name}")
            continue
        path = Path(location).absolute()
        found = _examine(search.kind, path, "PATH")
        if isinstance(found, InstalledEngine):
            search.found.append(found)
        else:
            search.notes.append(f"PATH: {path} {found}")


def _search_cache(search: EngineSearch) -> None:
    kind, root = search.kind, cache_root()
    if root is None:
        search.notes.append("cache: skipped, platformdirs is not installed")
        return
    for folder, record in cached_engines(kind):
        if kind.accepts(record.version):
            search.found.append(InstalledEngine.from_cache(kind, folder, record))
        else:
            version = f"{record.version_text}; {kind.traits.requirement}"
            search.notes.append(f"cache: {folder} is {version}")
    if not search.found:
        search.notes.append(f"cache: nothing usable in {root / 'engines' / kind}")
