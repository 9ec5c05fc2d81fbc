"""Sweeps: many runs of one game, whose settings Optuna proposes."""
