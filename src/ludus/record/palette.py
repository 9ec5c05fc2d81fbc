"""The 256 colours of a GIF, chosen from all of its frames."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from typing import Any

__all__ = ["Palette"]


class Palette:
    """Takes all pictures, then hands them out with one palette that serves them all.

    They are kept in memory, 3 bytes a pixel, until the last one has been added.

    Args:
        width: Of all pictures, pixels.
        height: Of all pictures, pixels.
        rate: Pictures per second.
    """

    def __init__(self, width: int, height: int, rate: Fraction) -> None:
        from av import VideoFormat
        from av.filter import Graph

        self._num_pictures = 0
        self._time_base = 1 / rate
        self._graph = graph = Graph()
        self._source: Any = graph.add_buffer(
            width=width, height=height, format=VideoFormat("rgb24"), time_base=self._time_base
        )
        split, choose = graph.add("split"), graph.add("palettegen", "stats_mode=full")
        # Dithering would flicker, and make the file three times as large.
        use, self._sink = graph.add("paletteuse", "dither=none"), graph.add("buffersink")
        self._source.link_to(split)
        split.link_to(choose, 0, 0)
        split.link_to(use, 1, 0)
        choose.link_to(use, 0, 1)
        use.link_to(self._sink)
        graph.configure()

    def add(self, picture: Any) -> None:
        """Take the next picture."""
        picture.pts = self._num_pictures
        picture.time_base = self._time_base
        self._num_pictures += 1
        self._source.push(picture)

    def pictures(self) -> Iterator[Any]:
        """Yield all pictures, with their palette; nothing can be added any more."""
        self._source.push(None)
        for _ in range(self._num_pictures):
            yield self._sink.pull()
