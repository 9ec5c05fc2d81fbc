"""Flat named tensors back into networks."""

from __future__ import annotations

from collections.abc import Mapping

from torch import Tensor, nn

from ludus.errors import CheckpointError

__all__ = ["load_tensors"]


def load_tensors(module: nn.Module, tensors: Mapping[str, Tensor], prefix: str) -> None:
    """Set the parameters and buffers of ``module`` from the tensors called ``prefix…``.

    Raises:
        CheckpointError: One is missing, is left over, or has another shape.
    """
    own = {
        name.removeprefix(prefix): tensor
        for name, tensor in tensors.items()
        if name.startswith(prefix)
    }
    try:
        module.load_state_dict(own)
    except RuntimeError as error:
        first = str(error).strip().splitlines()[-1].strip()
        raise CheckpointError(
            f"the checkpoint does not fit the network: {first}",
            "resume with the settings it was trained with (hidden_sizes, activation, …)",
        ) from None
