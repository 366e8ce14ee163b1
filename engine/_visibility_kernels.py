"""Depth maps behind :mod:`engine.visibility`."""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import FloatArray, IntArray


@kernel
def projected(points: FloatArray, frame: FloatArray, low: FloatArray) -> FloatArray:
    """Column, row and depth (k, 3) of ``points`` along the rows of ``frame``, from ``low``."""
    places = np.empty((len(points), 3))
    for i in range(len(points)):
        for k in range(3):
            along = frame[k, 0] * points[i, 0] + frame[k, 1] * points[i, 1]
            places[i, k] = along + frame[k, 2] * points[i, 2] - low[k]
    return places


@kernel
def depth_maps(
    corners: FloatArray, faces: IntArray, shape: tuple[int, int]
) -> tuple[FloatArray, FloatArray]:
    """The greatest and the least depth of ``faces`` at every pixel centre; ∓inf where none is.

    ``corners`` (n, 3) as :func:`projected` gives them, in pixels.
    """
    rows, columns = shape
    nearest = np.full((rows, columns), -np.inf)
    farthest = np.full((rows, columns), np.inf)
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay, az = corners[a, 0], corners[a, 1], corners[a, 2]
        bx, by, bz = corners[b, 0] - ax, corners[b, 1] - ay, corners[b, 2] - az
        cx, cy, cz = corners[c, 0] - ax, corners[c, 1] - ay, corners[c, 2] - az
        doubled = bx * cy - by * cx
        top = max(0, int(np.ceil(ay + min(0.0, by, cy))))
        bottom = min(rows - 1, int(np.floor(ay + max(0.0, by, cy))))
        left = max(0, int(np.ceil(ax + min(0.0, bx, cx))))
        right = min(columns - 1, int(np.floor(ax + max(0.0, bx, cx))))
        if doubled == 0 or top > bottom or left > right:
            continue
        for y in range(top, bottom + 1):
            for x in range(left, right + 1):
                v = ((x - ax) * cy - (y - ay) * cx) / doubled
                w = ((y - ay) * bx - (x - ax) * by) / doubled
                if min(v, w, 1 - v - w) >= -1e-9:
                    depth = az + v * bz + w * cz
                    nearest[y, x] = max(nearest[y, x], depth)
                    farthest[y, x] = min(farthest[y, x], depth)
    return nearest, farthest


@kernel
def add_sky(
    sky: FloatArray,
    seen: FloatArray,
    points: FloatArray,
    cosines: FloatArray,
    maps: tuple[FloatArray, FloatArray],
    least_cosine: float,
) -> None:
    """Add each point's cosine to ``sky``, and to ``seen`` if nothing lies before it.

    ``points`` (k, 3) as :func:`projected` gives them; a positive cosine looks toward greater
    depth, a negative one the other way. A surface that leans away from the view covers a pixel
    at many depths, so the comparison tolerates a pixel's worth of its slope.
    """
    nearest, farthest = maps
    for i in range(len(points)):
        cosine = abs(cosines[i])
        if cosine < least_cosine:
            continue
        x, y, depth = int(np.rint(points[i, 0])), int(np.rint(points[i, 1])), points[i, 2]
        slack = 1 + np.sqrt(1 - min(cosine, 1.0) ** 2) / cosine
        toward = depth >= nearest[y, x] - slack
        away = depth <= farthest[y, x] + slack
        sky[i] += cosine
        if (toward and cosines[i] > 0) or (away and cosines[i] < 0):
            seen[i] += cosine
