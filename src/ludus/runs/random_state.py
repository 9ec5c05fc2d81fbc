"""The process-wide random streams, as JSON values."""

from __future__ import annotations

import random
from typing import Any, cast

import numpy as np
import torch

from ludus.networks.tensors import to_numbers

__all__ = ["random_state", "restore_random_state"]


def random_state() -> dict[str, Any]:
    """Return the states of Python's, NumPy's and PyTorch's global generators."""
    version, internal, gauss = random.getstate()
    legacy = np.random.get_state(legacy=False)
    inner = cast(dict[str, Any], legacy["state"])
    return {
        "python": [version, list(internal), gauss],
        "numpy": {**legacy, "state": {"key": inner["key"].tolist(), "pos": inner["pos"]}},
        "torch": to_numbers(torch.get_rng_state()),
    }


def restore_random_state(state: dict[str, Any]) -> None:
    """Set the global generators to what :func:`random_state` returned."""
    version, internal, gauss = state["python"]
    random.setstate((version, tuple(internal), gauss))
    inner = state["numpy"]["state"]
    key = np.asarray(inner["key"], np.uint32)
    np.random.set_state({**state["numpy"], "state": {"key": key, "pos": inner["pos"]}})
    torch.set_rng_state(torch.tensor(state["torch"], dtype=torch.uint8))
