"""One pass of edge collapses behind :mod:`engine.decimation`."""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import BoolArray, FloatArray, IntArray


@kernel
def _shape(a: FloatArray, b: FloatArray, c: FloatArray) -> tuple[float, float, float, float]:
    """Doubled area vector of a triangle, and its length over the longest edge squared."""
    u = b - a
    v = c - a
    w = c - b
    n0 = u[1] * v[2] - u[2] * v[1]
    n1 = u[2] * v[0] - u[0] * v[2]
    n2 = u[0] * v[1] - u[1] * v[0]
    longest = max((u * u).sum(), (v * v).sum(), (w * w).sum())
    return n0, n1, n2, np.sqrt(n0 * n0 + n1 * n1 + n2 * n2) / (longest + 1e-300)


@kernel
def _keeps_shape(
    removed: int,
    kept: int,
    vertices: FloatArray,
    faces: IntArray,
    star: tuple[IntArray, IntArray],
) -> bool:
    """Whether no face around ``removed`` turns over or degenerates when it moves to ``kept``."""
    start, around = star
    for s in range(start[removed], start[removed + 1]):
        f = around[s]
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        if kept in (a, b, c):
            continue
        x0, x1, x2, _ = _shape(vertices[a], vertices[b], vertices[c])
        a, b, c = (
            kept if a == removed else a,
            kept if b == removed else b,
            kept if c == removed else c,
        )
        y0, y1, y2, quality = _shape(vertices[a], vertices[b], vertices[c])
        cosine = x0 * y0 + x1 * y1 + x2 * y2
        size = np.sqrt((x0 * x0 + x1 * x1 + x2 * x2) * (y0 * y0 + y1 * y1 + y2 * y2))
        if cosine < 0.5 * size or quality < 0.15:
            return False
    return True


@kernel
def collapse_pass(
    pairs: IntArray,
    mesh: tuple[FloatArray, IntArray],
    star: tuple[IntArray, IntArray],
    border: tuple[BoolArray, IntArray, IntArray],
    excess: int,
) -> IntArray:
    """Collapse edges ``pairs`` (e, 2) in order, no two in one neighbourhood, at most ``excess``.

    ``border``: whether vertices are on it, their loop, and the vertices left in each loop
    (updated). Returns where each vertex goes (n,); those that stay go to themselves.
    """
    vertices, faces = mesh
    start, around = star
    on_border, loop_of, loop_size = border
    n = len(vertices)
    goes = np.arange(n)
    locked = np.zeros(n, np.bool_)
    seen = np.full(n, -1)
    for e in range(len(pairs)):
        if excess <= 0:
            break
        a, b = pairs[e, 0], pairs[e, 1]
        if locked[a] or locked[b]:
            continue
        shared = 0
        for s in range(start[a], start[a + 1]):
            for k in range(3):
                seen[faces[around[s], k]] = 2 * e
        common = 0
        for s in range(start[b], start[b + 1]):
            f = around[s]
            if a in (faces[f, 0], faces[f, 1], faces[f, 2]):
                shared += 1
            for k in range(3):
                v = faces[f, k]
                if v not in (a, b) and seen[v] == 2 * e:
                    seen[v] = 2 * e + 1
                    common += 1
        if common != shared or (on_border[a] and on_border[b] and shared != 1):
            continue
        for turn in range(2):
            removed, kept = (a, b) if turn == 0 else (b, a)
            if on_border[removed] and (not on_border[kept] or loop_size[loop_of[removed]] <= 12):
                continue
            free = True
            for s in range(start[removed], start[removed + 1]):
                for k in range(3):
                    free &= not locked[faces[around[s], k]]
            if not free or not _keeps_shape(removed, kept, vertices, faces, star):
                continue
            goes[removed] = kept
            excess -= 1
            if on_border[removed]:
                loop_size[loop_of[removed]] -= 1
            for s in range(start[removed], start[removed + 1]):
                for k in range(3):
                    locked[faces[around[s], k]] = True
            break
    return goes
