"""Per-element loops behind :mod:`engine.nearest`."""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import FloatArray, IntArray


@kernel
def closest_on_triangle(
    p: FloatArray, a: FloatArray, b: FloatArray, c: FloatArray
) -> tuple[float, float, float]:
    """Barycentric coordinates of the point of triangle abc closest to p (Ericson 2005, 5.1.5)."""
    d1 = 0.0
    d2 = 0.0
    d3 = 0.0
    d4 = 0.0
    d5 = 0.0
    d6 = 0.0
    for k in range(3):
        ab = b[k] - a[k]
        ac = c[k] - a[k]
        d1 += ab * (p[k] - a[k])
        d2 += ac * (p[k] - a[k])
        d3 += ab * (p[k] - b[k])
        d4 += ac * (p[k] - b[k])
        d5 += ab * (p[k] - c[k])
        d6 += ac * (p[k] - c[k])
    vc = d1 * d4 - d3 * d2
    vb = d5 * d2 - d1 * d6
    va = d3 * d6 - d5 * d4
    u, v, w = 1.0, 0.0, 0.0
    if d1 <= 0 and d2 <= 0:
        pass
    elif d3 >= 0 and d4 <= d3:
        u, v = 0.0, 1.0
    elif d6 >= 0 and d5 <= d6:
        u, w = 0.0, 1.0
    elif vc <= 0 and d1 >= 0 and d3 <= 0:
        v = d1 / (d1 - d3)
        u = 1.0 - v
    elif vb <= 0 and d2 >= 0 and d6 <= 0:
        w = d2 / (d2 - d6)
        u = 1.0 - w
    elif va <= 0 and d4 >= d3 and d5 >= d6:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        u, v = 0.0, 1.0 - w
    elif va + vb + vc > 0:  # else a needle without area
        u, v, w = va / (va + vb + vc), vb / (va + vb + vc), vc / (va + vb + vc)
    return u, v, w


@kernel
def descend(
    points: FloatArray,
    first: IntArray,
    vertices: FloatArray,
    faces: IntArray,
    star: tuple[IntArray, IntArray],
) -> tuple[IntArray, FloatArray]:
    """Closest points by descent over vertex stars, beginning at the vertices ``first``.

    Looks through the star of a vertex, then through the stars of the best face's corners, while
    that still comes closer. Returns faces (k,) and barycentric coordinates (k, 3).
    """
    star_start, star_face = star
    count = len(points)
    face = np.zeros(count, np.int64)
    barycentric = np.zeros((count, 3))
    queue = np.zeros(3, np.int64)
    for i in range(count):
        best = np.inf
        queue[0] = first[i]
        waiting = 1
        for _ in range(4):
            closer = False
            for q in range(waiting):
                for s in range(star_start[queue[q]], star_start[queue[q] + 1]):
                    f = star_face[s]
                    a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
                    u, v, w = closest_on_triangle(points[i], vertices[a], vertices[b], vertices[c])
                    d = 0.0
                    for k in range(3):
                        foot = u * vertices[a, k] + v * vertices[b, k] + w * vertices[c, k]
                        d += (points[i, k] - foot) ** 2
                    if d < best * (1 - 1e-12):
                        best = d
                        face[i] = f
                        barycentric[i, 0] = u
                        barycentric[i, 1] = v
                        barycentric[i, 2] = w
                        closer = True
            if not closer:
                break
            for k in range(3):
                queue[k] = faces[face[i], k]
            waiting = 3
    return face, barycentric
