"""Vertices moved one by one over a surface until the faces around them lie upright on it."""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import BoolArray, ComplexArray, FloatArray, IntArray

FLAT = 1e-3  # a face that lies no better is turned over or collapsed
_STRAIGHT = 0.05  # of a shape: by so much charts differ
_SWEEPS, _PATIENCE = 30, 6  # over the vertices, and without a gain
_EQUILATERAL = 3.4641016151377544  # 2 √3: the signed area times this over the edges' squares is 1


@kernel
def _products(
    a: int, b: int, c: int, place: FloatArray, normal: FloatArray
) -> tuple[float, float, float]:
    """Of a face's doubled area vector and the sum of the surface's normals at its corners: their
    product, and either one's square."""
    dot = 0.0
    across = 0.0
    along = 0.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        up = (place[b, j] - place[a, j]) * (place[c, k] - place[a, k])
        up -= (place[b, k] - place[a, k]) * (place[c, j] - place[a, j])
        below = normal[a, i] + normal[b, i] + normal[c, i]
        dot += up * below
        across += up * up
        along += below * below
    return dot, across, along


@kernel
def uprightness(
    a: int, b: int, c: int, area: float, z: ComplexArray, place: FloatArray, normal: FloatArray
) -> float:
    """How well a face lies: the least of its signed shape in the chart (1 if equilateral), the
    cosine between its normal in space and the surface's there, and its size relative to ``area``.

    Charts differ in what of a needle is straight: a little below 0 its shape is good enough.

    ``z`` (n,) in the chart, ``place`` and ``normal`` (n, 3) on the surface at its corners
    ``a``, ``b``, ``c``.
    """
    p, q, r = z[b] - z[a], z[c] - z[b], z[a] - z[c]
    squares = abs(p) ** 2 + abs(q) ** 2 + abs(r) ** 2
    shape = 0.0
    if squares > 0:
        shape = -_EQUILATERAL * (p.real * r.imag - p.imag * r.real) / squares
    dot, across, along = _products(a, b, c, place, normal)
    cosine = 0.0
    if across > 0 and along > 0:
        cosine = dot / np.sqrt(across * along)
    size = np.sqrt(across) / (2 * area)
    return min(shape + _STRAIGHT, cosine, size)


@kernel
def uprightnesses(
    faces: IntArray, areas: FloatArray, z: ComplexArray, place: FloatArray, normal: FloatArray
) -> FloatArray:
    """``uprightness`` of each of ``faces`` (m, 3)."""
    least = np.empty(len(faces))
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        least[f] = uprightness(a, b, c, areas[f], z, place, normal)
    return least


@kernel
def upside_down(
    faces: IntArray, areas: FloatArray, place: FloatArray, normal: FloatArray
) -> BoolArray:
    """Which ``faces`` (m, 3) of ``areas`` (m,) turn from the surface's normals, or are flat.

    ``place`` and ``normal`` (n, 3) on the surface at their corners.
    """
    turned = np.empty(len(faces), np.bool_)
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        dot, across, _ = _products(a, b, c, place, normal)
        turned[f] = dot <= 0 or np.sqrt(across) <= 2 * FLAT * areas[f]
    return turned


@kernel
def _cost(least: float, margin: float) -> float:
    """What a face costs that lies so: nothing beyond ``margin``, 1 more where it is turned."""
    if least >= margin:
        return 0.0
    return margin - least + (1.0 if least <= FLAT else 0.0)


@kernel
def set_upright(
    faces: tuple[IntArray, FloatArray, IntArray, IntArray],
    movable: IntArray,
    images: tuple[IntArray, ComplexArray, FloatArray, FloatArray],
    candidates: tuple[IntArray, ComplexArray, FloatArray, FloatArray],
    weights: tuple[float, float],
) -> IntArray:
    """Move ``movable`` (k,) vertices among ``candidates`` so that ``faces`` cost less.

    ``faces``: corners (m, 3), areas (m,), and the faces around each vertex (starts, faces).
    ``images`` and ``candidates``: kinds, chart positions, places and normals of the vertices
    (n, …) and of the points (c, …) of the surface that those of the same kind may become, sorted
    by the real part in the chart.
    ``weights``: the margin of ``_cost`` and the price of a unit of way. Faces that stay turned
    over count more and more, which moves them to where there is room. Returns which candidate
    each vertex (n,) became, or -1, when the fewest were turned over; changes ``images``.
    """
    _, z, place, normal = images
    became = np.full(len(z), -1)
    best = became.copy()
    fewest = len(faces[0]) + 1
    home = place.copy()
    urgency = np.ones(len(faces[0]))
    patience = _PATIENCE
    for _ in range(_SWEEPS):
        changed = False
        for v in movable:
            chosen = _better(v, faces, images, candidates, home[v], urgency, weights)
            if chosen >= 0:
                became[v] = chosen
                changed = True
                z[v], place[v] = candidates[1][chosen], candidates[2][chosen]
                normal[v] = candidates[3][chosen]
        turned = uprightnesses(faces[0], faces[1], z, place, normal) <= FLAT
        count = turned.sum()
        patience -= 1
        if count < fewest:
            patience = _PATIENCE
        if count <= fewest:
            fewest = count
            best[:] = became
        if patience == 0 or (count == 0 and not changed):
            break
        urgency[turned] *= 2.0
    return best


@kernel
def _better(
    v: int,
    faces: tuple[IntArray, FloatArray, IntArray, IntArray],
    images: tuple[IntArray, ComplexArray, FloatArray, FloatArray],
    candidates: tuple[IntArray, ComplexArray, FloatArray, FloatArray],
    home: FloatArray,
    urgency: FloatArray,
    weights: tuple[float, float],
) -> int:
    """The candidate that is best for ``v``, or -1 if it is best where it is."""
    kind, z, place, normal = images
    margin, price = weights
    now = _star_cost(v, faces, images, urgency, margin, np.inf)
    if now == 0:
        return -1
    best = now + price * np.sqrt(((place[v] - home) ** 2).sum()) - 1e-9
    chosen = -1
    before = z[v], place[v].copy(), normal[v].copy()
    low, high = _extent(v, faces, z)
    first = np.searchsorted(candidates[1].real, low.real)
    for c in range(first, len(candidates[1])):
        w = candidates[1][c]
        if w.real > high.real:
            break
        if candidates[0][c] != kind[v] or w.imag < low.imag or w.imag > high.imag:
            continue
        square = 0.0
        for i in range(3):
            square += (candidates[2][c, i] - home[i]) ** 2
        way = price * np.sqrt(square)
        if way >= best:
            continue
        z[v] = w
        for i in range(3):
            place[v, i], normal[v, i] = candidates[2][c, i], candidates[3][c, i]
        total = way + _star_cost(v, faces, images, urgency, margin, best - way)
        if total < best:
            best, chosen = total, c
    z[v], place[v], normal[v] = before
    return chosen


@kernel
def _star_cost(
    v: int,
    faces: tuple[IntArray, FloatArray, IntArray, IntArray],
    images: tuple[IntArray, ComplexArray, FloatArray, FloatArray],
    urgency: FloatArray,
    margin: float,
    enough: float,
) -> float:
    """The cost of the faces around ``v``, or any part of it that is not below ``enough``."""
    corners, areas, start, around = faces
    _, z, place, normal = images
    total = 0.0
    for k in range(start[v], start[v + 1]):
        f = int(around[k])
        a, b, c = corners[f, 0], corners[f, 1], corners[f, 2]
        least = uprightness(a, b, c, areas[f], z, place, normal)
        total += urgency[f] * _cost(least, margin)
        if total >= enough:
            break
    return total


@kernel
def _extent(
    v: int, faces: tuple[IntArray, FloatArray, IntArray, IntArray], z: ComplexArray
) -> tuple[complex, complex]:
    """The lower left and the upper right corner of the faces around ``v``."""
    corners, _, start, around = faces
    low, high = z[v], z[v]
    for k in range(start[v], start[v + 1]):
        for i in range(3):
            w = z[corners[around[k], i]]
            low = complex(min(low.real, w.real), min(low.imag, w.imag))
            high = complex(max(high.real, w.real), max(high.imag, w.imag))
    return low, high
