"""NumPy arrays as tensors and back, with the types that PyTorch leaves open."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

__all__ = ["as_tensor", "as_tensors", "to_numbers"]


def as_tensor(array: NDArray[Any], device: torch.device | None = None) -> Tensor:
    """Return a tensor of ``array``; on the CPU it shares memory with a contiguous one."""
    tensor = cast(Any, torch).from_numpy(np.ascontiguousarray(array))
    return tensor if device is None else tensor.to(device)


def as_tensors(entries: Mapping[str, NDArray[Any]], device: torch.device) -> dict[str, Tensor]:
    """Return a tensor of every entry."""
    return {name: as_tensor(array, device) for name, array in entries.items()}


def to_numbers(tensor: Tensor) -> list[float]:
    """Return the elements of a vector."""
    return cast(list[float], cast(Any, tensor).tolist())
