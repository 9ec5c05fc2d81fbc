"""Serve games that ask for training: a package for each dialect that they speak.

``guided`` is for games with our add-on, ``godot_ai`` for games that were written for godot-ai.
"""
