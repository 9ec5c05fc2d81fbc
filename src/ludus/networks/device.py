"""Where networks compute, and in which precision."""

from __future__ import annotations

from contextlib import AbstractContextManager

import torch

from ludus.errors import ConfigError
from ludus.settings.train_config import TrainConfig

__all__ = ["choose_device", "mixed_precision", "uses_bfloat16"]


def choose_device(name: str) -> torch.device:
    """Return the device called ``name``; ``"auto"`` is cuda where there is one, else the CPU.

    Raises:
        ConfigError: There is no such device here.
    """
    if name == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    try:
        device = torch.device(name)
        torch.zeros(1, device=device)
    except (RuntimeError, AssertionError) as error:
        reason = str(error).splitlines()[0]
        raise ConfigError(
            f"device {name} cannot be used: {reason}", "--device cpu always works"
        ) from None
    return device


def uses_bfloat16(config: TrainConfig, device: torch.device) -> bool:
    """Return whether updates are computed in mixed precision."""
    if config.precision == "auto":
        return device.type == "cuda" and torch.cuda.is_bf16_supported()
    return config.precision == "bfloat16"


def mixed_precision(device: torch.device, is_mixed: bool) -> AbstractContextManager[object]:
    """Return a context in which matrix products are computed in bfloat16, if ``is_mixed``."""
    return torch.autocast(device.type, torch.bfloat16, enabled=is_mixed)
