"""Read ``project.godot`` without an engine.

The file has ``[section]`` lines and ``key=value`` entries whose values are GDScript literals;
a value may span several lines. Only the values that Ludus needs are interpreted; everything else
keeps its text and its place, so that one value can be replaced without changing the rest.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

__all__ = [
    "ConfigEntry",
    "ConfigFile",
    "add_string",
    "add_to_string_array",
    "parse_config",
    "parse_string",
    "quote_string",
]

_ESCAPES = {"n": "\n", "t": "\t", "r": "\r"}
# A string that nothing closes goes on to the end of the file.
_TOKEN = re.compile(r'"(?:[^"\\]|\\.)*"?|[()\[\]{}\n]', re.DOTALL)
_QUOTED = re.compile(r'"((?:[^"\\]|\\.)*)"', re.DOTALL)


@dataclass(frozen=True)
class ConfigEntry:
    """One ``key=value``.

    Attributes:
        value: Text of the value as written in the file.
        start: Offset of the value.
        end: Offset after the value.
    """

    value: str
    start: int
    end: int


@dataclass
class ConfigFile:
    """A parsed file.

    Attributes:
        text: The whole file.
        entries: Entries by ``section/key``; the first section is ``""``, so the key
            ``config_version`` there is ``/config_version``.
        section_ends: Per section, the offset where the next entry would go.
    """

    text: str
    entries: dict[str, ConfigEntry] = field(default_factory=dict[str, ConfigEntry])
    section_ends: dict[str, int] = field(default_factory=dict[str, int])

    def string(self, key: str) -> str | None:
        """Return a string value, or None if the key is missing or something else."""
        entry = self.entries.get(key)
        return None if entry is None else parse_string(entry.value)

    def integer(self, key: str) -> int | None:
        """Return a whole number, or None if the key is missing or something else."""
        entry = self.entries.get(key)
        if entry is None:
            return None
        try:
            return int(entry.value)
        except ValueError:
            return None

    def strings(self, key: str) -> list[str]:
        """Return every quoted string in a value: the elements of a string array."""
        entry = self.entries.get(key)
        return [] if entry is None else [_unescape(text) for text in _QUOTED.findall(entry.value)]


def parse_config(text: str) -> ConfigFile:
    """Parse ``project.godot``; malformed lines are skipped."""
    parsed = ConfigFile(text)
    section, offset = "", 0
    parsed.section_ends[section] = 0
    while offset < len(text):
        line_end = text.find("\n", offset)
        if line_end < 0:
            line_end = len(text)
        line = text[offset:line_end].strip()
        if line.startswith("[") and line.endswith("]"):
            section = line[1:-1]
            parsed.section_ends[section] = line_end
        elif "=" in line and not line.startswith((";", "#")):
            line_end = _add_entry(parsed, section, offset)
            parsed.section_ends[section] = line_end
        offset = line_end + 1
    return parsed


def parse_string(value: str) -> str | None:
    """Decode a quoted string, or return None if it is something else."""
    match = _QUOTED.fullmatch(value.strip().removeprefix("&"))
    return None if match is None else _unescape(match[1])


def quote_string(text: str) -> str:
    """Encode a string as in the file, quotes included."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'


def add_to_string_array(
    text: str, key: str, value: str, array_type: str = "PackedStringArray"
) -> str:
    """Return the text of a file with one more string in an array of strings.

    Everything else keeps its text and its place. Key and section are added if missing; if the
    array contains the string already, the text is returned unchanged.

    Args:
        text: The whole file.
        key: ``section/key`` of the array.
        value: String to add.
        array_type: The engine's name for such an array.
    """
    parsed = parse_config(text)
    strings = parsed.strings(key)
    if value in strings:
        return text
    array = f"{array_type}({', '.join(quote_string(item) for item in [*strings, value])})"
    entry = parsed.entries.get(key)
    if entry is not None:
        return text[: entry.start] + array + text[entry.end :]
    section, _, name = key.partition("/")
    return _with_new_entry(parsed, section, f"{name}={array}")


def add_string(text: str, key: str, value: str) -> str:
    """Return the text of a file with ``key`` set to a string, unless it has a value already.

    Args:
        text: The whole file.
        key: ``section/key``.
        value: The string.
    """
    parsed = parse_config(text)
    if key in parsed.entries:
        return text
    section, _, name = key.partition("/")
    return _with_new_entry(parsed, section, f"{name}={quote_string(value)}")


def _with_new_entry(parsed: ConfigFile, section: str, line: str) -> str:
    text = parsed.text
    newline = "\r\n" if "\r\n" in text else "\n"
    end = parsed.section_ends.get(section)
    if end is None:
        body = text.rstrip("\r\n")
        return f"{body}{newline}{newline}[{section}]{newline}{newline}{line}{newline}"
    lead = text[:end].removesuffix("\r")
    return f"{lead}{newline}{line}{text[len(lead) :] or newline}"


def _unescape(text: str) -> str:
    return re.sub(r"\\(.)", lambda match: _ESCAPES.get(match[1], match[1]), text, flags=re.DOTALL)


def _add_entry(parsed: ConfigFile, section: str, offset: int) -> int:
    """Add the entry that starts at ``offset``; return where its last line ends."""
    equals = parsed.text.index("=", offset)
    key = parsed.text[offset:equals].strip().strip('"')
    end = _value_end(parsed.text, equals + 1)
    raw = parsed.text[equals + 1 : end]
    start = equals + 1 + len(raw) - len(raw.lstrip())
    parsed.entries[f"{section}/{key}"] = ConfigEntry(raw.strip(), start, start + len(raw.strip()))
    return end


def _value_end(text: str, offset: int) -> int:
    """Find the line end that is outside of strings and brackets."""
    depth = 0
    for token in _TOKEN.finditer(text, offset):
        if token[0] in "([{":
            depth += 1
        elif token[0] in ")]}":
            depth -= 1
        elif token[0] == "\n" and depth <= 0:
            return token.start()
    return len(text)
