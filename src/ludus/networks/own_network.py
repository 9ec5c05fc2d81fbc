"""A network that a script made, in the place of Ludus's own."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import torch
from torch import Tensor, nn

from ludus.errors import UsageError
from ludus.networks.networks import Inputs, ObservationEncoder
from ludus.spec import PolicySpec

__all__ = ["PREFIX", "MakeNetwork", "OwnTorso"]

MakeNetwork = Callable[[PolicySpec], nn.Module]
"""Makes the network of a policy; called again for each copy that an algorithm needs."""

PREFIX = "torso.network."
"""How the tensors of such a network are called in the state of a policy."""


class OwnTorso(nn.Module):
    """From inputs to one vector per row, by a module of a script.

    An ``nn.Sequential`` gets ``float32[n, size]``, all entries joined. Any other module gets a
    dictionary: ``float32[n, *shape]`` by entry, images as ``uint8[n, height, width, channels]``.
    Either way entries but images are normalised unless the policy's settings say otherwise.

    Args:
        make: Makes the module.
        spec: What the policy observes.
        encoder: Of the policy.

    Attributes:
        network: The module.
        size: Elements of its output.

    Raises:
        UsageError: There is no module, or it does not return ``float32[n, features]``.
    """

    def __init__(self, make: MakeNetwork, spec: PolicySpec, encoder: ObservationEncoder) -> None:
        super().__init__()
        made: Any = make(spec)
        where = f"the network of policy {spec.name}"
        if not isinstance(made, nn.Module):
            raise UsageError(f"{where} must be a torch.nn.Module, not {type(made).__name__}")
        self.network = made
        self._shapes = encoder.vector_shapes
        self._image_names = encoder.image_names
        vector = torch.zeros(2, encoder.vector_size)
        images = tuple(torch.zeros(2, *shape).byte() for shape in encoder.image_shapes)
        with torch.no_grad():
            features: Any = self(Inputs(vector, images))
        if not isinstance(features, Tensor) or features.dim() != 2 or len(features) != 2:
            came = list(features.shape) if isinstance(features, Tensor) else type(features).__name__
            raise UsageError(
                f"{where} must return one vector per row, float32[2, features] here, not {came}",
                "flatten what it returns: x.flatten(1)",
            )
        self.size = features.shape[1]

    def forward(self, inputs: Inputs) -> Tensor:
        """Return ``float32[n, size]``."""
        if isinstance(self.network, nn.Sequential) and not inputs.images:
            return self.network(inputs.vector)
        return self.network(self._entries(inputs))

    def _entries(self, inputs: Inputs) -> Mapping[str, Tensor]:
        entries = dict(zip(self._image_names, inputs.images, strict=True))
        start = 0
        for name, shape in self._shapes.items():
            size = math.prod(shape)
            entries[name] = inputs.vector[:, start : start + size].reshape(-1, *shape)
            start += size
        return entries
