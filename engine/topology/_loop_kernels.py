"""Walks around vertices and along boundaries; half-edges as in ``_halfedges``."""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import IntArray


@kernel
def fans_of_corners(twin: IntArray) -> tuple[IntArray, int]:
    """Number the fans: corners of faces around one vertex that are joined by shared edges.

    Corner c is the start of half-edge c.
    """
    count = len(twin)
    fan = np.full(count, -1, dtype=np.int64)
    fans = 0
    for corner in range(count):
        if fan[corner] >= 0:
            continue
        at = corner
        while at >= 0 and fan[at] < 0:
            fan[at] = fans
            at = twin[at - at % 3 + (at % 3 + 2) % 3]
        opposite = twin[corner]
        while opposite >= 0:
            at = opposite - opposite % 3 + (opposite % 3 + 1) % 3
            if fan[at] >= 0:
                break
            fan[at] = fans
            opposite = twin[at]
        fans += 1
    return fan, fans


@kernel
def simple_loops(
    rim: IntArray, origin: IntArray, target: IntArray, twin: IntArray, vertex_count: int
) -> tuple[IntArray, IntArray]:
    """The boundary half-edges ``rim`` in loop order, and where each loop starts (one at the end).

    The first of ``rim`` that is left starts a walk. It turns through the faces around each vertex,
    so it follows one fan at a time; where it comes back to a vertex that it has already left, the
    part in between is split off as a loop.
    """
    boundary = len(rim)
    loops = np.empty(boundary, dtype=np.int64)
    starts = np.zeros(boundary + 1, dtype=np.int64)
    stack = np.empty(boundary, dtype=np.int64)
    depth_of = np.full(vertex_count, -1, dtype=np.int64)
    seen = np.zeros(len(origin), dtype=np.bool_)
    filled = 0
    found = 0
    for first in rim:
        if seen[first]:
            continue
        h = first
        depth = 0
        while not seen[h]:
            seen[h] = True
            stack[depth] = h
            depth_of[origin[h]] = depth
            depth += 1
            back = depth_of[target[h]]
            if back >= 0:
                for i in range(back, depth):
                    loops[filled] = stack[i]
                    depth_of[origin[stack[i]]] = -1
                    filled += 1
                found += 1
                starts[found] = filled
                depth = back
            h = h - h % 3 + (h % 3 + 1) % 3
            while twin[h] >= 0:
                h = twin[h]
                h = h - h % 3 + (h % 3 + 1) % 3
    return loops, starts[: found + 1]
