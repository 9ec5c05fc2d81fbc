"""Find an installed engine: the one the user names, then ``PATH``, then the user cache."""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass, field
from pathlib import Path

from ludus.engine.cache import CacheRecord, cache_root, cached_records
from ludus.engine.kinds import EngineKind, Version
from ludus.engine.version import ask_version, show_version
from ludus.errors import ConfigError, EngineNotFound

__all__ = ["EngineSearch", "InstalledEngine", "find_engine", "list_engines", "search_engines"]


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
    def from_cache(cls, kind: EngineKind, folder: Path, record: CacheRecord) -> InstalledEngine:
        """Describe an engine that lies in the user cache."""
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
        """Whether it opens a window in any case: a Godot 3 that is no build for servers."""
        is_server = self.window_path is not None or "server" in self.path.name
        return self.kind is EngineKind.GODOT3 and not is_server


@dataclass
class EngineSearch:
    """What a search came across.

    Attributes:
        kind: What was looked for.
        found: Usable engines, in the order of preference.
        notes: One line per place looked at, and why it did not serve.
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
        ConfigError: The executable that the user named is missing or unfit.
        EngineNotFound: There is no usable engine; the text lists every place looked at.
    """
    named = _named_by_user(kind, explicit)
    if named is not None:
        return _accept_named(kind, *named)
    search = EngineSearch(kind)
    _search_path(search)
    if not search.found:
        _search_cache(search)
    if not search.found:
        raise _not_found(search)
    return search.found[0]


def search_engines(kind: EngineKind) -> EngineSearch:
    """Look in every place for one kind of engine; nothing raises."""
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
    path = _inside_app_bundle(path.expanduser())
    hint = f"correct {source}, or leave it out to use an engine from PATH or the cache"
    if not path.is_file():
        raise ConfigError(f"{source} names {path}, which is not a file", hint)
    if not os.access(path, os.X_OK):
        raise ConfigError(f"{source} names {path}, which is not executable", hint)
    answer = ask_version(path)
    if answer is None:
        raise ConfigError(f"{source} names {path}, which does not answer --version", hint)
    version, text = answer
    if not kind.accepts(version):
        raise ConfigError(f"{source} names {path}, {_wrong_version(kind, text)}", hint)
    return InstalledEngine(kind, path.absolute(), version, text, source)


def _inside_app_bundle(path: Path) -> Path:
    """Turn a macOS ``Godot.app`` into the executable inside."""
    inner = path / "Contents" / "MacOS" / "Godot"
    return inner if path.suffix == ".app" and inner.is_file() else path


def _wrong_version(kind: EngineKind, text: str) -> str:
    traits = kind.traits
    return f"which is {text}; {traits.label} needs {show_version(traits.minimum_version)} or newer"


def _search_path(search: EngineSearch) -> None:
    for name in search.kind.traits.path_names:
        location = shutil.which(name)
        if location is None:
            search.notes.append(f"PATH: no {name}")
            continue
        _consider_on_path(search, Path(location).absolute())


def _consider_on_path(search: EngineSearch, path: Path) -> None:
    answer = ask_version(path)
    if answer is None:
        search.notes.append(f"PATH: {path} does not answer --version")
    elif not search.kind.accepts(answer[0]):
        search.notes.append(f"PATH: {path}, {_wrong_version(search.kind, answer[1])}")
    else:
        search.found.append(InstalledEngine(search.kind, path, *answer, source="PATH"))


def _search_cache(search: EngineSearch) -> None:
    root = cache_root()
    if root is None:
        search.notes.append("cache: skipped, platformdirs is not installed")
        return
    for folder, record in cached_records(search.kind):
        if not search.kind.accepts(record.version):
            search.notes.append(
                f"cache: {folder}, {_wrong_version(search.kind, record.version_text)}"
            )
            continue
        search.found.append(InstalledEngine.from_cache(search.kind, folder, record))
    if not search.found:
        search.notes.append(f"cache: nothing usable in {root / 'engines' / search.kind}")


def _not_found(search: EngineSearch) -> EngineNotFound:
    traits = search.kind.traits
    looked = [f"${traits.environment_variable}: not set", *search.notes]
    lines = "\n".join(f"  {note}" for note in looked)
    return EngineNotFound(
        f"no {traits.label} was found; looked at\n{lines}",
        hint=f"ludus engine install {search.kind}",
    )
