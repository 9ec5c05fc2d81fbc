"""A real editor on a screen, which a script drives as a person would."""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil
import pytest

from ludus.addon.new_project import ProjectKind, make_project
from ludus.engine import (
    EngineKind,
    EngineProcess,
    LaunchConfig,
    ensure_imported,
    find_engine,
    read_project,
    with_display,
)
from tests.editor_probe import PROBE, PROBE_PLUGIN

TIMEOUT_S = 400.0
LOOK = """\
@tool
extends RefCounted
const QUICK := "--num-worlds 8 --num-engines 1 --evaluation-episodes 0"
var result := {{}}
var plugin: EditorPlugin
var tree: SceneTree = Engine.get_main_loop()
var dock: Node

func open() -> void:
	EditorInterface.open_scene_from_path("res://game.tscn")
	dock = find_dock(EditorInterface.get_base_control())
	plugin.make_bottom_panel_item_visible(dock)
	await wait(func() -> bool: return dock.is_ready_to_start())

func find_dock(node: Node) -> Node:
	var script: Script = node.get_script()
	if script != null and script.resource_path == "res://addons/ludus/editor/dock.gd":
		return node
	for child: Node in node.get_children():
		var found := find_dock(child)
		if found != null:
			return found
	return null

func wait(is_over: Callable, seconds: float = 200.0) -> void:
	var end := Time.get_ticks_msec() + int(seconds * 1000.0)
	while not is_over.call() and Time.get_ticks_msec() < end:
		await tree.process_frame

func run(button: String) -> void:
	dock.buttons[button].pressed.emit()
	await wait(func() -> bool: return not dock.command.is_running())

func shoot(name: String) -> void:
	for i: int in 5:
		await tree.process_frame
	RenderingServer.force_draw()  # an editor in which nothing changes does not draw by itself
	var picture := EditorInterface.get_base_control().get_viewport().get_texture().get_image()
	picture.save_png("{pictures}".path_join(name + ".png"))

"""

Look = Callable[[str], dict[str, Any]]


@pytest.fixture(scope="session")
def imported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project that `ludus new --2d` makes, and a plugin that runs ``look.gd`` in the editor."""
    folder = make_project(tmp_path_factory.mktemp("editor") / "game", ProjectKind.TWO_D)
    probe = folder / "addons" / "probe"
    probe.mkdir()
    (probe / "plugin.cfg").write_text(PROBE_PLUGIN)
    (probe / "probe.gd").write_text(PROBE)
    settings = folder / "project.godot"
    own = '"res://addons/ludus/plugin.cfg"'
    text = settings.read_text()
    assert own in text
    settings.write_text(text.replace(own, f'{own}, "res://addons/probe/plugin.cfg"'))
    ensure_imported(find_engine(EngineKind.GODOT4), read_project(folder))
    return folder


@pytest.fixture(scope="module")
def project(imported: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return shutil.copytree(imported, tmp_path_factory.mktemp("project") / "game")


@pytest.fixture(scope="module")
def look(project: Path, tmp_path_factory: pytest.TempPathFactory) -> Look:
    """Return what opens the project in the editor, and what GDScript puts into ``result``.

    The Ludus of the tests is the one that installed the add-on. Pictures that the script takes
    lie in ``$LUDUS_PICTURES``, or else in a folder of the test.
    """
    folder = tmp_path_factory.mktemp("look")
    pictures = Path(os.environ.get("LUDUS_PICTURES", folder))
    installer = folder / "config" / "ludus" / "python"
    installer.parent.mkdir(parents=True)
    installer.write_text(f"{sys.executable}\n")
    environment = {
        "LUDUS_PYTHON": sys.executable,
        # Mesa maps its cache; another program that shortens it ends the editor by SIGBUS.
        "MESA_SHADER_CACHE_DIR": str(folder / "mesa"),
        "XDG_CONFIG_HOME": str(folder / "config"),  # the editor's settings, and those of Ludus
    }

    def run(script: str) -> dict[str, Any]:
        (project / "look.gd").write_text(LOOK.format(pictures=pictures) + script)
        godot = str(find_engine(EngineKind.GODOT4).executable(headless=False))
        command = (godot, "--rendering-driver", "opengl3", "--resolution", "1280x800", "--editor")
        command = with_display((*command, "--path", str(project)))
        log = folder / "editor.log"
        with pytest.MonkeyPatch.context() as patch:
            for name, value in environment.items():
                patch.setenv(name, value)
            with EngineProcess.start(LaunchConfig(command=command, log_path=log)) as process:
                exit_code = process.wait(TIMEOUT_S)
        lines = log.read_text(errors="replace").splitlines()
        end = "\n".join(lines[-40:])
        assert exit_code == 0, end
        assert not [line for line in lines if "SCRIPT ERROR" in line], end
        results = [line for line in lines if line.startswith("PROBE ")]
        assert results, end
        return json.loads(results[0].removeprefix("PROBE "))

    return run


def processes_of(project: Path) -> list[str]:
    """Return the command lines of all processes that have to do with a project."""
    found: list[str] = []
    for process in psutil.process_iter():
        try:
            line = " ".join(process.cmdline())
        except psutil.Error:
            continue
        if str(project) in line and process.pid != os.getpid():
            found.append(line)
    return found
