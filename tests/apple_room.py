"""The room of apple_seeker, and what sixteen rays in it must meet, by geometry."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

SIGHT, REACH, APPLE_RADIUS = 5.0, 0.9, 0.45
START = (-1.3, 0.3)
SPOTS = [
    (3.3, 2.3),
    (3.3, 0.2),
    (3.4, -2.4),
    (1.3, -2.3),
    (-0.2, -2.3),
    (-3.4, -1.4),
    (-3.4, 0.4),
    (-3.4, 2.3),
    (-1.0, 2.3),
    (1.2, 2.3),
]
# Edges in x and in z, metres: sofa, table, shelf, crate, plant, and the room from inside.
FURNITURE = [
    ((-3.1, -0.9), (-3.0, -2.1)),
    ((-0.5, 1.3), (-0.6, 0.4)),
    ((2.0, 2.4), (1.0, 3.0)),
    ((2.25, 3.15), (-1.75, -0.85)),
    ((-2.85, -2.15), (1.15, 1.85)),
]
ROOM = ((-4.0, 4.0), (-3.0, 3.0))
ANGLES = np.arange(16) * 2 * np.pi / 16
DIRECTIONS = np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1)
"""The first points to +x, the next ones turn towards +z."""

Point = tuple[float, float]
Floats = NDArray[np.float64]


def distances_to_box(place: Point, box: tuple[Point, Point]) -> tuple[Floats, Floats]:
    """Return where each ray enters and leaves a box; it misses one that it leaves first."""
    with np.errstate(divide="ignore"):
        times = (np.array(box) - np.array(place)[:, np.newaxis]) / DIRECTIONS[:, :, np.newaxis]
    return times.min(axis=2).max(axis=1), times.max(axis=2).min(axis=1)


def distances_to_furniture(place: Point) -> Floats:
    nearest = distances_to_box(place, ROOM)[1]
    for box in FURNITURE:
        enters, leaves = distances_to_box(place, box)
        nearest = np.where((enters > 0) & (enters < leaves), np.minimum(nearest, enters), nearest)
    return nearest


def distances_to_apple(place: Point, apple: Point) -> Floats:
    """Return infinity for rays that miss it."""
    way = np.array(apple) - np.array(place)
    along = DIRECTIONS @ way
    off_squared = way @ way - along**2
    is_hit = (off_squared < APPLE_RADIUS**2) & (along > 0)
    return np.where(is_hit, along - np.sqrt(np.maximum(APPLE_RADIUS**2 - off_squared, 0.0)), np.inf)


def seen_from(place: Point, apple: Point) -> tuple[Floats, Floats]:
    """Return what the rays must say: distances to obstacles and to the apple."""
    furniture, target = distances_to_furniture(place), distances_to_apple(place, apple)
    obstacle = np.minimum(np.minimum(furniture, target), SIGHT)
    return obstacle, np.where((target < furniture) & (target < SIGHT), target, SIGHT)
