"""Games that speak the protocol of another project, driven from Python as they are.

``gymgodot`` drives projects written for GymGodot (Godot 3, JSON over a WebSocket).
"""
