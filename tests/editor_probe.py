"""A plugin that lets a test look into a real editor: res://look.gd looks, the result is printed."""

from __future__ import annotations

PROBE_PLUGIN = """\
[plugin]

name="Probe"
description=""
author=""
version="1"
script="probe.gd"
"""
# What a test wants to know is printed as one line of JSON.
PROBE = """\
@tool
extends EditorPlugin
func _ready() -> void:
	if not ResourceLoader.exists("res://look.gd"):
		return
	while EditorInterface.get_resource_filesystem().is_scanning():
		await get_tree().process_frame
	await get_tree().create_timer(1.0).timeout
	var look: RefCounted = load("res://look.gd").new()
	look.plugin = self
	await look.look()
	print("PROBE ", JSON.stringify(look.result))
	get_tree().quit()
"""
