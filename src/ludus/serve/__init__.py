"""Serve games that ask for training.

``guided`` is for games with our add-on, ``godot_ai`` for games that were written for godot-ai.
"""
