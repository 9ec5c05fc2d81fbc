from __future__ import annotations

import importlib

import ludus.train


def test_every_public_name_is_what_it_says() -> None:
    for module in ("config", "evaluation", "loop", "policy", "progress", "saved", "source"):
        importlib.import_module(f"ludus.train.{module}")
    for name in ludus.train.__all__:
        assert getattr(ludus.train, name).__name__ == name
