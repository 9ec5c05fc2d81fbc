"""The code that the pages show runs, parses or compiles; what can't be run says why.

A block that is not run has a line ``<!-- not run: REASON -->`` before it. `test_readme` and
`test_python_page` run those of the README and the examples of docs/python.md, and look further.
"""

from __future__ import annotations

import importlib
import re
import shlex
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from ludus.addon import install_addon
from ludus.cli.main import COMMANDS, parse
from ludus.engine import EngineKind, ensure_imported, find_engine, read_project
from ludus.errors import LudusError

ROOT = Path(__file__).parents[2]
GENERATED = ROOT / "docs" / "reference"
PAGES = [
    ROOT / "README.md",
    *sorted(page for page in (ROOT / "docs").rglob("*.md") if GENERATED not in page.parents),
]
BLOCK = re.compile(
    r"(?:<!-- (?:not run|example): (?P<reason>.+?) -->\n)?^(?P<indent> *)```(?P<language>[\w,]*)\n"
    r"(?P<code>.*?)^(?P=indent)```$",
    re.MULTILINE | re.DOTALL,
)


@dataclass(frozen=True)
class Block:
    page: str
    line: int
    language: str
    code: str
    reason: str | None

    def __str__(self) -> str:
        return f"{self.page}:{self.line}"


def _blocks(language: str) -> list[Block]:
    found: list[Block] = []
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for match in BLOCK.finditer(text):
            if match["language"] == language:
                line = text.count("\n", 0, match.start("code"))
                name = page.relative_to(ROOT).as_posix()
                found.append(Block(name, line, language, match["code"], match["reason"]))
    return found


def _command_lines() -> list[str]:
    blocks = _blocks("") + _blocks("sh")
    lines = "\n".join(block.code for block in blocks).replace("\\\n", " ").splitlines()
    return sorted({line.strip() for line in lines if line.strip().startswith("ludus ")})


@pytest.mark.parametrize("line", _command_lines())
def test_a_documented_command_line_is_accepted(line: str) -> None:
    _, name, *arguments = shlex.split(line, comments=True)
    if name.startswith("--") or "--help" in arguments:
        return
    module: Any = importlib.import_module(COMMANDS[name][0])
    try:
        parse(module, name, arguments)
    except LudusError as error:  # no such run or file here; flags and values were all right
        assert any(given in error.message for given in arguments), error.message


def _runnable() -> list[Any]:
    """Blocks about other libraries run where these are; their warnings are their own."""
    marks = [
        pytest.mark.libraries,
        pytest.mark.filterwarnings("ignore"),
        pytest.mark.timeout(400, func_only=True),
    ]
    return [
        pytest.param(
            block, id=str(block), marks=marks if block.page.startswith("docs/libraries/") else []
        )
        for block in _blocks("python")
        if not block.reason and block.page != "README.md"
    ]


@pytest.mark.engine
@pytest.mark.games
@pytest.mark.slow
@pytest.mark.parametrize("block", _runnable())
def test_a_python_block_runs(block: Block, shorten_training: Callable[[int], None]) -> None:
    shorten_training(2048)
    exec(compile(block.code, str(block), "exec"), {})


CHECK = {
    EngineKind.GODOT4: """\
extends Node

func _ready() -> void:
	for path in DirAccess.get_files_at("res://blocks"):
		var script := GDScript.new()
		script.source_code = FileAccess.get_file_as_string("res://blocks/" + path)
		if script.reload() != OK:
			print("does not compile: ", path)
	get_tree().quit()
""",
    EngineKind.GODOT3: """\
extends Node

func _ready() -> void:
	var folder := Directory.new()
	folder.open("res://blocks")
	folder.list_dir_begin(true)
	var path := folder.get_next()
	while path != "":
		var file := File.new()
		file.open("res://blocks/" + path, File.READ)
		var script := GDScript.new()
		script.source_code = file.get_as_text()
		if script.reload() != OK:
			print("does not compile: ", path)
		path = folder.get_next()
	get_tree().quit()
""",
}
SCENE = """\
[gd_scene load_steps=2 format=2]
[ext_resource path="res://check.gd" type="Script" id=1]
[node name="Check" type="Node"]
script = ExtResource( 1 )
"""
BASE = {EngineKind.GODOT4: "CharacterBody2D", EngineKind.GODOT3: "KinematicBody2D"}
"""What a script of a page extends that shows methods only: a node of the game."""
GODOT3_PAGES = {"docs/godot3.md", "docs/godot_gym_api.md", "docs/gymgodot.md"}


@pytest.mark.engine
@pytest.mark.parametrize("kind", [EngineKind.GODOT4, EngineKind.GODOT3])
def test_gdscript_blocks_compile(kind: EngineKind, tmp_path: Path) -> None:
    """All in one process, as scripts of a project with the add-on and its autoload."""
    is_godot3 = kind is EngineKind.GODOT3
    shown = [block for block in _blocks("gdscript") if not block.reason]
    blocks = [block for block in shown if (block.page in GODOT3_PAGES) == is_godot3]
    assert blocks
    (tmp_path / "project.godot").write_text(f"config_version={4 if is_godot3 else 5}\n")
    install_addon(tmp_path)
    (tmp_path / "check.gd").write_text(CHECK[kind])
    (tmp_path / "check.tscn").write_text(SCENE)
    (tmp_path / "blocks").mkdir()
    for block in blocks:
        base = "" if "extends " in block.code else f"extends {BASE[kind]}\n"
        name = f"{block.page.replace('/', '-')}-{block.line}.txt"
        (tmp_path / "blocks" / name).write_text(base + block.code, encoding="utf-8")
    engine = find_engine(kind)
    ensure_imported(engine, read_project(tmp_path))
    run = [engine.path, *(() if is_godot3 else ("--headless",)), "--path", tmp_path, "check.tscn"]
    checked = subprocess.run(run, check=True, capture_output=True, text=True, timeout=120)
    assert "does not compile" not in checked.stdout, checked.stdout + checked.stderr
