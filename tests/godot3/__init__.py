"""The add-on for Godot 3, on the real engine."""
