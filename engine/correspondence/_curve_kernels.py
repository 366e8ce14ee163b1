"""Per-point loops behind :mod:`engine.correspondence._curves`."""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import FloatArray, IntArray


@kernel
def closest_on_polyline(
    points: FloatArray, starts: FloatArray, steps: FloatArray
) -> tuple[IntArray, FloatArray]:
    """The segment (m,) closest to each of ``points`` (m, 3), and how far along it, in [0, 1].

    Segment k goes from ``starts`` (k, 3) by ``steps`` (k, 3); the first of equally close ones.
    """
    segment = np.zeros(len(points), np.int64)
    part = np.zeros(len(points))
    for i in range(len(points)):
        best = np.inf
        for k in range(len(starts)):
            x = points[i, 0] - starts[k, 0]
            y = points[i, 1] - starts[k, 1]
            z = points[i, 2] - starts[k, 2]
            a, b, c = steps[k, 0], steps[k, 1], steps[k, 2]
            t = min(max((x * a + y * b + z * c) / max(a * a + b * b + c * c, 1e-300), 0.0), 1.0)
            gap = (x - t * a) ** 2 + (y - t * b) ** 2 + (z - t * c) ** 2
            if gap < best:
                best = gap
                segment[i] = k
                part[i] = t
    return segment, part
