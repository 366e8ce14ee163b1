"""Loops over the half-edges of an intrinsic triangulation.

Half-edge 3 t + k runs from corner k to corner k + 1 of face t.
"""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import FloatArray, IntArray


@kernel
def mollified_lengths(vertices: FloatArray, faces: IntArray, share: float) -> FloatArray:
    """Lengths (3 m,) of the half-edges, all longer by the same amount, so that every triangle
    inequality holds by ``share`` of the mean length (Sharp & Crane 2020)."""
    count = 3 * len(faces)
    length = np.empty(count)
    for h in range(count):
        a = faces[h // 3, h % 3]
        b = faces[h // 3, (h % 3 + 1) % 3]
        square = 0.0
        for k in range(3):
            square += (vertices[a, k] - vertices[b, k]) ** 2
        length[h] = np.sqrt(square)
    margin = share * length.mean()
    added = 0.0
    for t in range(len(faces)):
        for k in range(3):
            slack = length[3 * t + k] + length[3 * t + (k + 1) % 3] - length[3 * t + (k + 2) % 3]
            added = max(added, margin - slack)
    return length + added


@kernel
def _half_cotangent(length: FloatArray, h: int) -> float:
    """Half the cotangent of the angle opposite to half-edge ``h`` (Heron)."""
    t, k = h // 3, h % 3
    across, left, right = length[h], length[3 * t + (k + 1) % 3], length[3 * t + (k + 2) % 3]
    whole = across + left + right
    sixteen = whole * (left + right - across) * (across + right - left) * (across + left - right)
    area4 = np.sqrt(max(sixteen, 1e-24 * whole**4))
    return 0.5 * (left * left + right * right - across * across) / area4


@kernel
def half_cotangents(length: FloatArray) -> FloatArray:
    """Half cotangents (m, 3) of the angle at each corner."""
    weights = np.empty((len(length) // 3, 3))
    for t in range(len(weights)):
        for k in range(3):
            weights[t, k] = _half_cotangent(length, 3 * t + (k + 1) % 3)
    return weights


@kernel
def _flip(faces: IntArray, length: FloatArray, opposite: IntArray, h: int) -> None:
    """Replace edge ab of the faces (a, b, c) at h and (b, a, d) beyond by the edge cd."""
    g = opposite[h]
    t, k, u, j = h // 3, h % 3, g // 3, g % 3
    bc, ca = 3 * t + (k + 1) % 3, 3 * t + (k + 2) % 3
    ad, db = 3 * u + (j + 1) % 3, 3 * u + (j + 2) % 3
    a, b, c, d = faces[t, k], faces[u, j], faces[t, (k + 2) % 3], faces[u, (j + 2) % 3]
    base = length[h]
    cx = (base**2 + length[ca] ** 2 - length[bc] ** 2) / (2 * base)
    cy = np.sqrt(max(length[ca] ** 2 - cx**2, 0.0))
    dx = (base**2 + length[ad] ** 2 - length[db] ** 2) / (2 * base)
    dy = np.sqrt(max(length[ad] ** 2 - dx**2, 0.0))
    before = (bc, ca, ad, db)
    after = (3 * t + 2, 3 * u + 1, 3 * u + 2, 3 * t + 1)
    sides = (length[bc], length[ca], length[ad], length[db])
    outer = (opposite[bc], opposite[ca], opposite[ad], opposite[db])
    faces[t, 0], faces[t, 1], faces[t, 2] = c, d, b
    faces[u, 0], faces[u, 1], faces[u, 2] = d, c, a
    length[3 * t] = length[3 * u] = np.hypot(cx - dx, cy + dy)
    opposite[3 * t], opposite[3 * u] = 3 * u, 3 * t
    for q in range(4):
        length[after[q]] = sides[q]
        across = outer[q]
        for other in range(4):
            if outer[q] == before[other]:
                across = after[other]
        opposite[after[q]] = across
        if across >= 0:
            opposite[across] = after[q]


@kernel
def flip_to_delaunay(
    faces: IntArray, length: FloatArray, opposite: IntArray, flips_per_face: int
) -> int:
    """Flip edges, in place, until the angles opposite to each sum to at most π; count the flips.

    Stops after ``flips_per_face`` flips per face, which only rounding can reach.
    """
    count = 3 * len(faces)
    stack = np.empty(count, np.int64)
    waiting = np.zeros(count, np.bool_)
    top = flips = 0
    for h in range(count):
        if opposite[h] > h:
            stack[top] = h
            waiting[h] = True
            top += 1
    while top > 0 and flips < flips_per_face * len(faces):
        top -= 1
        h = int(stack[top])
        waiting[h] = False
        g = int(opposite[h])
        if g < 0 or g // 3 == h // 3:
            continue
        if _half_cotangent(length, h) + _half_cotangent(length, g) >= -1e-10:
            continue
        _flip(faces, length, opposite, h)
        flips += 1
        t, u = h // 3, g // 3
        for q in (3 * t + 1, 3 * t + 2, 3 * u + 1, 3 * u + 2):
            if opposite[q] >= 0 and not waiting[q]:
                stack[top] = q
                waiting[q] = True
                top += 1
    return flips


@kernel
def steep_floor(density: FloatArray, share: float) -> FloatArray:
    """The least values (b,) >= ``density`` around a loop that are >= ``share`` of neighbours."""
    raised = density.copy()
    for _ in range(2):
        for i in range(len(raised)):
            raised[i] = max(raised[i], share * raised[i - 1])
        for i in range(len(raised) - 1, -1, -1):
            raised[i - 1] = max(raised[i - 1], share * raised[i])
    return raised
