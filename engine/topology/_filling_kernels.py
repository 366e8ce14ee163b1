"""Triangulation of closed space polygons by dynamic programming."""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import BoolArray, FloatArray, IntArray


@kernel
def minimal_triangulation(
    points: FloatArray, forbidden: BoolArray, compactness: float
) -> tuple[IntArray, float]:
    """The triangulation of the polygon ``points`` (k, 3) of least total cost, and that cost.

    A triangle costs its area plus ``compactness`` times the sum of its squared sides. Chords
    (i, j) with ``forbidden[i, j]`` are not used; the cost is infinite if nothing else remains.
    Triangles (k - 2, 3) run in the polygon's direction. Barequet and Sharir (1995); O(k^3).
    """
    k = len(points)
    cost = np.zeros((k, k))
    apex = np.full((k, k), -1, dtype=np.int64)
    square = np.zeros((k, k))
    for i in range(k):
        for j in range(k):
            for c in range(3):
                square[i, j] += (points[i, c] - points[j, c]) ** 2
    for span in range(2, k):
        for i in range(k - span):
            j = i + span
            best = np.inf
            if not forbidden[i, j] or span == k - 1:
                for m in range(i + 1, j):
                    below = cost[i, m] + cost[j, m]
                    if below >= best:
                        continue
                    a, b, c = square[i, m], square[m, j], square[i, j]
                    area16 = 4.0 * a * b - (a + b - c) ** 2
                    total = below + compactness * (a + b + c)
                    if area16 > 0.0:
                        total += 0.25 * np.sqrt(area16)
                    if total < best:
                        best = total
                        apex[i, j] = m
            cost[i, j] = best
            cost[j, i] = best
    triangles = np.empty((k - 2, 3), dtype=np.int64)
    if not np.isfinite(cost[0, k - 1]):
        return triangles, np.inf
    stack = np.empty((k, 2), dtype=np.int64)
    stack[0, 0], stack[0, 1] = 0, k - 1
    depth, found = 1, 0
    while depth:
        depth -= 1
        i, j = stack[depth, 0], stack[depth, 1]
        if j - i < 2:
            continue
        m = apex[i, j]
        triangles[found, 0], triangles[found, 1], triangles[found, 2] = i, m, j
        found += 1
        stack[depth, 0], stack[depth, 1] = i, m
        stack[depth + 1, 0], stack[depth + 1, 1] = m, j
        depth += 2
    return triangles, cost[0, k - 1]


@kernel
def dividing_chord(points: FloatArray, forbidden: IntArray, stride: int) -> tuple[int, int]:
    """The chord of a polygon that is shortest against the shorter way round; (-1, -1) if none.

    Both parts get at least a quarter of the corners. ``forbidden`` holds sorted i k + j, i < j;
    every ``stride``-th corner is tried as an end.
    """
    k = len(points)
    along = np.zeros(k + 1)
    for i in range(k):
        step = 0.0
        for c in range(3):
            step += (points[(i + 1) % k, c] - points[i, c]) ** 2
        along[i + 1] = along[i] + np.sqrt(step)
    best = np.inf
    chosen = (-1, -1)
    for i in range(0, k, stride):
        for j in range(i + k // 4, min(k, i + k - k // 4 + 1), stride):
            way = min(along[j] - along[i], along[k] - along[j] + along[i])
            if way <= 0.0:
                continue
            length = 0.0
            for c in range(3):
                length += (points[i, c] - points[j, c]) ** 2
            ratio = length / (way * way)
            if ratio < best:
                place = np.searchsorted(forbidden, i * k + j)
                if place < len(forbidden) and forbidden[place] == i * k + j:
                    continue
                best = ratio
                chosen = (i, j)
    return chosen
