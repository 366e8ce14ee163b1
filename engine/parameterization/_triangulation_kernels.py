"""Loops over triangle lists: repeated half-edges, connection, surroundings."""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import BoolArray, IntArray


@kernel
def repeated_halfedges(faces: IntArray, n: int) -> BoolArray:
    """Faces (m,) with a side that another one has in the same direction, or a corner twice."""
    count = 3 * len(faces)
    head = np.full(n, -1, np.int64)
    following = np.full(count, -1, np.int64)
    bad = np.zeros(len(faces), np.bool_)
    for h in range(count):
        a, b = faces[h // 3, h % 3], faces[h // 3, (h % 3 + 1) % 3]
        if a == b:
            bad[h // 3] = True
        g = head[a]
        while g >= 0:
            if faces[g // 3, (g % 3 + 1) % 3] == b:
                bad[h // 3] = True
                bad[g // 3] = True
            g = following[g]
        following[h] = head[a]
        head[a] = h
    return bad


@kernel
def reached(opposite: IntArray) -> BoolArray:
    """The faces (m,) connected to the first one across half-edges ``opposite`` (3 m,)."""
    count = len(opposite) // 3
    seen = np.zeros(count, np.bool_)
    stack = np.empty(count, np.int64)
    top = 0
    if count:
        seen[0] = True
        stack[0] = 0
        top = 1
    while top > 0:
        top -= 1
        t = stack[top]
        for k in range(3):
            g = opposite[3 * t + k]
            if g >= 0 and not seen[g // 3]:
                seen[g // 3] = True
                stack[top] = g // 3
                top += 1
    return seen


@kernel
def grow(inside: BoolArray, faces: IntArray, rings: int) -> BoolArray:
    """The vertices (n,) within ``rings`` faces of those ``inside``."""
    inside = inside.copy()
    for _ in range(rings):
        before = inside.copy()
        for t in range(len(faces)):
            if before[faces[t, 0]] or before[faces[t, 1]] or before[faces[t, 2]]:
                for i in range(3):
                    inside[faces[t, i]] = True
    return inside
