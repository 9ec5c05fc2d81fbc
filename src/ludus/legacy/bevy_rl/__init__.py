"""Drives programs that speak the REST interface of bevy_rl."""
