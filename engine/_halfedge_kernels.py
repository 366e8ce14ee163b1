"""Half-edges of a triangle list: number 3 t + k runs from corner k of face t to the next corner."""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import IntArray


@kernel
def opposite_halfedges(faces: IntArray, n: int) -> IntArray:
    """The half-edge (3 m,) that runs the other way along the same edge, -1 on the boundary."""
    count = 3 * len(faces)
    head = np.full(n, -1, np.int64)
    following = np.full(count, -1, np.int64)
    opposite = np.full(count, -1, np.int64)
    for h in range(count):
        a = faces[h // 3, h % 3]
        following[h] = head[a]
        head[a] = h
    for h in range(count):
        if opposite[h] >= 0:
            continue
        a = faces[h // 3, h % 3]
        g = head[faces[h // 3, (h % 3 + 1) % 3]]
        while g >= 0:
            if faces[g // 3, (g % 3 + 1) % 3] == a:
                opposite[h] = g
                opposite[g] = h
                break
            g = following[g]
    return opposite
