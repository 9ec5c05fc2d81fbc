"""Reading and changing project.godot."""

from __future__ import annotations

import pytest

from ludus.engine.config_file import add_to_string_array, parse_config

TEXT = """\
; a comment with = and [brackets]
config_version=5

[application]

config/name="A \\"quoted\\" name; with = and [x]"
config/description="two
[lines]
fake=1"
run/main_scene = "res://main.tscn"

[input]

jump={
"deadzone": 0.5,
"events": [Object(InputEventKey,"text":"]}")
]
}
[physics]
common/physics_ticks_per_second=120
nonsense
"""


def test_values_are_found_whatever_is_around_them() -> None:
    config = parse_config(TEXT)
    assert config.integer("/config_version") == 5
    assert config.string("application/config/name") == 'A "quoted" name; with = and [x]'
    assert config.string("application/config/description") == "two\n[lines]\nfake=1"
    assert config.string("application/run/main_scene") == "res://main.tscn"
    assert config.integer("physics/common/physics_ticks_per_second") == 120
    assert len(config.entries) == 6
    assert list(config.section_ends) == ["", "application", "input", "physics"]


def test_entries_know_their_place() -> None:
    config = parse_config(TEXT)
    for entry in config.entries.values():
        assert TEXT[entry.start : entry.end] == entry.value


def test_other_types_and_missing_keys_are_none() -> None:
    config = parse_config('a=1.5\nb=true\nc="x" + "y"')
    assert config.integer("/a") is None
    assert config.string("/b") is None
    assert config.string("/c") is None
    assert config.string("/d") is None
    assert config.integer("/d") is None


@pytest.mark.parametrize(
    "text", ["", "=", "[", "a=", 'a="', "a=(((", "\n\n", '"]=[', "a=\\", 'a="\\']
)
def test_broken_files_are_tolerated(text: str) -> None:
    parse_config(text)


KEY = "editor_plugins/enabled"
VALUE = "res://p.cfg"


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("a=1\n", 'a=1\n\n[editor_plugins]\n\nenabled=PackedStringArray("res://p.cfg")\n'),
        (
            "[editor_plugins]\n\n[z]\nb=1\n",
            '[editor_plugins]\nenabled=PackedStringArray("res://p.cfg")\n\n[z]\nb=1\n',
        ),
        ("[editor_plugins]", '[editor_plugins]\nenabled=PackedStringArray("res://p.cfg")\n'),
        (
            '[editor_plugins]\nenabled=PackedStringArray("res://o.cfg")\nq=2\n[z]\n',
            '[editor_plugins]\nenabled=PackedStringArray("res://o.cfg", "res://p.cfg")\nq=2\n[z]\n',
        ),
        (
            '[editor_plugins]\nenabled=PackedStringArray(\n"res://o.cfg"\n)\n',
            '[editor_plugins]\nenabled=PackedStringArray("res://o.cfg", "res://p.cfg")\n',
        ),
        (
            "[editor_plugins]\r\nq=1\r\n",
            '[editor_plugins]\r\nq=1\r\nenabled=PackedStringArray("res://p.cfg")\r\n',
        ),
        (
            "[editor_plugins]\nenabled=PackedStringArray()\n",
            '[editor_plugins]\nenabled=PackedStringArray("res://p.cfg")\n',
        ),
    ],
)
def test_string_is_added_and_the_rest_stays(before: str, after: str) -> None:
    assert add_to_string_array(before, KEY, VALUE) == after
    assert add_to_string_array(after, KEY, VALUE) == after
    assert parse_config(after).strings(KEY)[-1] == VALUE
