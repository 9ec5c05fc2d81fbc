"""Training, evaluation and trained policies for scripts; what :mod:`ludus` exports of them."""
