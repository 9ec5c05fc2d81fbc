from __future__ import annotations

from tests.training.environments import register

register()
