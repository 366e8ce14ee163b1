"""Drawing into images, for pictures of planes and of figures."""

from __future__ import annotations

import numpy as np

from engine._raster_kernels import (
    Pixels,
    binned,
    nearest_colours,
    paint_lines,
    paint_triangles,
    replaced_colours,
)
from engine.types import FloatArray, IntArray

_HEAT = (
    (255, 255, 204),
    (255, 237, 160),
    (254, 217, 118),
    (254, 178, 76),
    (253, 141, 60),
    (252, 78, 42),
    (227, 26, 28),
    (189, 0, 38),
    (128, 0, 38),
)  # ColorBrewer's YlOrRd
_PALETTE = 256
_SHIFT = 3  # bits of a channel that tell no colours apart


class Canvas:
    """A white picture of RGB ``pixels`` (height, width, 3), drawn on in pixels from the top left.

    Colours are RGB triples from 0 to 255.
    """

    def __init__(self, width: int, height: int) -> None:
        self.pixels: Pixels = np.full((height, width, 3), 255, dtype=np.uint8)

    def copy(self) -> Canvas:
        """The same picture, to be drawn on apart."""
        other = Canvas(0, 0)
        other.pixels = self.pixels.copy()
        return other

    def triangles(
        self,
        at: FloatArray,
        faces: IntArray,
        colours: Pixels,
        line: tuple[int, int, int],
        *,
        width: float,
    ) -> None:
        """``faces`` (m, 3) of points ``at`` (n, 2) in ``colours`` (m, 3), sides in ``line``."""
        paint_triangles(self.pixels, np.ascontiguousarray(at), faces, colours, _colour(line), width)

    def lines(self, ends: FloatArray, colour: tuple[int, int, int], *, width: float) -> None:
        """Lines ``ends`` (k, 2, 2), each from one point to another."""
        paint_lines(self.pixels, np.ascontiguousarray(ends), _colour(colour), width)

    def dots(self, at: FloatArray, colour: tuple[int, int, int], *, width: float) -> None:
        """Dots at ``at`` (k, 2)."""
        self.lines(np.stack([at, at], axis=1), colour, width=width)


def heat(values: FloatArray) -> Pixels:
    """Colours (m, 3) from pale yellow at 0 to dark red at 1 and beyond."""
    steps = np.linspace(0.0, 1.0, len(_HEAT))
    bands = [np.interp(values, steps, band) for band in np.array(_HEAT).T]
    return np.rint(np.stack(bands, axis=1)).astype(np.uint8)


def few_colours(pixels: Pixels) -> tuple[Pixels, Pixels]:
    """A picture (height, width, 3) in the 256 colours that most of its pixels have.

    Answers with the palette (p, 3) and the number (height, width) of each pixel's colour in it.
    """
    counts, sums = binned(np.ascontiguousarray(pixels), _SHIFT)
    used = np.flatnonzero(counts)
    means = sums[used] / counts[used, None]
    most = np.argsort(-counts[used], kind="stable")[:_PALETTE]
    number = np.zeros(len(counts), dtype=np.uint8)
    number[used] = nearest_colours(means, means[most])
    palette = np.rint(means[most]).astype(np.uint8)
    return palette, replaced_colours(np.ascontiguousarray(pixels), _SHIFT, number)


def _colour(triple: tuple[int, int, int]) -> Pixels:
    return np.array(triple, dtype=np.uint8)
