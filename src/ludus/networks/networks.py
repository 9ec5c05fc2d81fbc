"""Parts of networks over named observation entries: an encoder, convolutions, layers."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeVar

import torch
from torch import Tensor, nn
from torch.nn import functional

from ludus.model.policy_model import image_shape, is_image
from ludus.networks.normalise import RunningNormaliser
from ludus.networks.tensors import take_rows
from ludus.spec import ObservationEntry

__all__ = [
    "ACTIVATIONS",
    "FeatureTorso",
    "ImageTorso",
    "Inputs",
    "ObservationEncoder",
    "perceptron",
]

ACTIVATIONS: dict[str, type[nn.Module]] = {
    "tanh": nn.Tanh,
    "relu": nn.ReLU,
    "elu": nn.ELU,
    "silu": nn.SiLU,
}

IMAGE_FEATURES = 256

Layer = TypeVar("Layer", nn.Linear, nn.Conv2d)


@dataclass(frozen=True)
class Inputs:
    """Observations as networks take them.

    Attributes:
        vector: ``float32[n, size]``, all entries but images, flat, joined and normalised.
        images: ``uint8[n, height, width, channels]`` each.
    """

    vector: Tensor
    images: tuple[Tensor, ...] = ()

    def rows(self, index: Tensor | slice) -> Inputs:
        """Return some of the rows."""
        images = tuple(take_rows(image, index) for image in self.images)
        return Inputs(take_rows(self.vector, index), images)

    def __len__(self) -> int:
        return len(self.vector)


class ObservationEncoder(nn.Module):
    """Turn named entries into :class:`Inputs`.

    An entry is an image if it is ``uint8`` and has three or more axes.

    Attributes:
        vector_size: Elements of all other entries in sum.
        vector_shapes: Their shapes by name, in order.
        image_names: Of the image entries.
        image_shapes: ``(height, width, channels)`` of each image entry.
    """

    def __init__(self, entries: tuple[ObservationEntry, ...], normalise: bool) -> None:
        super().__init__()
        images = [entry for entry in entries if is_image(entry)]
        vectors = [entry for entry in entries if not is_image(entry)]
        self.image_names = [entry.name for entry in images]
        self.vector_shapes = {entry.name: entry.shape for entry in vectors}
        self.vector_size = sum(entry.size for entry in vectors)
        shapes = map(image_shape, images)
        self.image_shapes = [(height, width, channels) for channels, height, width in shapes]
        self.normaliser = RunningNormaliser(self.vector_size) if normalise else None

    def forward(self, observation: Mapping[str, Tensor]) -> Inputs:
        """Return the inputs of ``dtype[n, *shape]`` entries."""
        vector = self.join(observation)
        if self.normaliser is not None:
            vector = self.normaliser(vector)
        images = (observation[name] for name in self.image_names)
        shaped = [
            _channels_together(image, shape)
            for image, shape in zip(images, self.image_shapes, strict=True)
        ]
        return Inputs(vector, tuple(shaped))

    def join(self, observation: Mapping[str, Tensor]) -> Tensor:
        """Return all vector entries, flat and joined: ``float32[n, vector_size]``."""
        parts = [observation[name].flatten(1) for name in self.vector_shapes]
        if len(parts) == 1:
            return parts[0].float()
        if not parts:
            image = observation[self.image_names[0]]
            return torch.zeros(len(image), 0, device=image.device)
        return torch.cat([part.float() for part in parts], 1)


class ImageTorso(nn.Module):
    """Convolutions over one image (Mnih et al. 2015; smaller kernels below 36 pixels)."""

    def __init__(self, shape: tuple[int, int, int]) -> None:
        super().__init__()
        height, width, channels = shape
        layers = [(32, 8, 4), (64, 4, 2), (64, 3, 1)] if min(height, width) >= 36 else []
        modules: list[nn.Module] = []
        for filters, kernel, stride in layers or [(32, 3, 2), (64, 3, 2)]:
            padding = 0 if layers else 1
            convolution = nn.Conv2d(channels, filters, kernel, stride, padding)
            modules += [initialise(convolution, math.sqrt(2)), nn.ReLU()]
            channels = filters
        self.convolutions = nn.Sequential(*modules, nn.Flatten())
        with torch.no_grad():
            size = self.convolutions(torch.zeros(1, shape[2], height, width)).shape[1]
        self.linear = initialise(nn.Linear(size, IMAGE_FEATURES), math.sqrt(2))

    def forward(self, image: Tensor) -> Tensor:
        """Return ``float32[n, 256]`` of ``uint8[n, height, width, channels]``."""
        scaled = image.permute(0, 3, 1, 2).float().div_(255.0)
        return functional.relu(self.linear(self.convolutions(scaled)))


class FeatureTorso(nn.Module):
    """From inputs to one vector per row: images through convolutions, the rest as it is.

    Attributes:
        size: Elements of that vector.
    """

    def __init__(self, encoder: ObservationEncoder) -> None:
        super().__init__()
        self.images = nn.ModuleList(ImageTorso(shape) for shape in encoder.image_shapes)
        self.size = encoder.vector_size + IMAGE_FEATURES * len(self.images)

    def forward(self, inputs: Inputs) -> Tensor:
        """Return ``float32[n, size]``."""
        if not inputs.images:
            return inputs.vector
        pairs = zip(self.images, inputs.images, strict=True)
        return torch.cat([inputs.vector, *(torso(image) for torso, image in pairs)], 1)


def perceptron(sizes: tuple[int, ...], activation: str, last_gain: float) -> nn.Sequential:
    """Return linear layers of ``sizes`` with ``activation`` between them."""
    modules: list[nn.Module] = []
    for inputs, outputs in itertools.pairwise(sizes[:-1]):
        modules += [initialise(nn.Linear(inputs, outputs), math.sqrt(2)), ACTIVATIONS[activation]()]
    modules.append(initialise(nn.Linear(sizes[-2], sizes[-1]), last_gain))
    return nn.Sequential(*modules)


def initialise(layer: Layer, gain: float) -> Layer:
    """Give ``layer`` orthogonal weights and no bias (Saxe et al. 2014)."""
    nn.init.orthogonal_(layer.weight, gain)
    if layer.bias is not None:
        nn.init.zeros_(layer.bias)
    return layer


def _channels_together(image: Tensor, shape: tuple[int, int, int]) -> Tensor:
    """Move stacked frames ``[n, frames…, h, w, c]`` into the channels."""
    if image.dim() == 4:
        return image
    frames = image.flatten(1, image.dim() - 4)
    return frames.permute(0, 2, 3, 4, 1).reshape(len(image), *shape)
