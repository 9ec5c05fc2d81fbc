"""Pictures of agents, who stand side by side in one PNG."""

from __future__ import annotations

import io
from typing import Any, cast

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ludus.errors import ConfigError, GameError

__all__ = ["PIXELS", "image_space", "split_picture"]

PIXELS = "pixels"
"""The entry of a dictionary space that holds the picture."""

_IMAGE_DIMENSIONS = 3
_MODES = {1: "L", 3: "RGB", 4: "RGBA"}
"""Pillow's names, by the number of channels."""


def image_space(space: spaces.Space[Any]) -> spaces.Box:
    """Return the box of an agent's picture: the space itself, or its entry ``pixels``.

    Raises:
        ConfigError: It is not a picture.
    """
    found: Any = cast("Any", space).spaces.get(PIXELS) if isinstance(space, spaces.Dict) else space
    if _is_image(found):
        return found
    raise ConfigError(
        f"with_pixels needs a uint8 box (height, width, 1, 3 or 4 channels), not {found}",
        hint=f"the observation space itself, or the entry {PIXELS!r} of a dictionary",
    )


def split_picture(picture: bytes, box: spaces.Box, num_agents: int) -> list[NDArray[np.uint8]]:
    """Return the pictures of all agents, who stand from left to right in one PNG.

    Args:
        picture: The PNG.
        box: Of one agent's picture: height, width, channels (1: grey, 3: RGB, 4: RGBA).
        num_agents: How many there are.

    Raises:
        GameError: It is not such a picture.
    """
    from PIL import Image

    height, width, channels = box.shape
    try:
        with Image.open(io.BytesIO(picture), formats=["PNG"]) as image:
            size = image.size
            _check_size(size, (width, height), num_agents)
            pixels = np.asarray(image.convert(_MODES[channels]))
    except (OSError, ValueError, Image.DecompressionBombError) as error:
        raise GameError(f"/visual_observations was not answered with a PNG: {error}") from error
    columns = pixels.reshape(height, num_agents, width, channels)
    return [columns[:, agent] for agent in range(num_agents)]


def _check_size(size: tuple[int, int], one: tuple[int, int], num_agents: int) -> None:
    width, height = one
    if size != (width * num_agents, height):
        raise GameError(
            f"the picture has {size[0]} x {size[1]} pixels, expected {width * num_agents} x "
            f"{height}: {num_agents} of {width} x {height} side by side",
            hint="the space of pixels must be that of one agent, (height, width, channels)",
        )


def _is_image(space: Any) -> bool:
    if not isinstance(space, spaces.Box) or len(space.shape) != _IMAGE_DIMENSIONS:
        return False
    return cast("Any", space).dtype == np.uint8 and space.shape[2] in _MODES
