"""Per-element loops behind :mod:`engine.nearest`."""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import FloatArray, IntArray


@kernel
def summed_vertex_normals(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Unit vertex normals (n, 3), faces weighted by area; 0 where the star has no area."""
    normals = np.zeros_like(vertices)
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        u0 = vertices[b, 0] - vertices[a, 0]
        u1 = vertices[b, 1] - vertices[a, 1]
        u2 = vertices[b, 2] - vertices[a, 2]
        w0 = vertices[c, 0] - vertices[a, 0]
        w1 = vertices[c, 1] - vertices[a, 1]
        w2 = vertices[c, 2] - vertices[a, 2]
        for k in range(3):
            v = faces[f, k]
            normals[v, 0] += u1 * w2 - u2 * w1
            normals[v, 1] += u2 * w0 - u0 * w2
            normals[v, 2] += u0 * w1 - u1 * w0
    for v in range(len(normals)):
        length = np.sqrt(normals[v, 0] ** 2 + normals[v, 1] ** 2 + normals[v, 2] ** 2)
        if length > 0:
            for k in range(3):
                normals[v, k] /= length
    return normals


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
    if d1 <= 0 and d2 <= 0:
        return 1.0, 0.0, 0.0
    if d3 >= 0 and d4 <= d3:
        return 0.0, 1.0, 0.0
    if d6 >= 0 and d5 <= d6:
        return 0.0, 0.0, 1.0
    vc = d1 * d4 - d3 * d2
    if vc <= 0 and d1 >= 0 and d3 <= 0:
        t = d1 / (d1 - d3)
        return 1.0 - t, t, 0.0
    vb = d5 * d2 - d1 * d6
    if vb <= 0 and d2 >= 0 and d6 <= 0:
        t = d2 / (d2 - d6)
        return 1.0 - t, 0.0, t
    va = d3 * d6 - d5 * d4
    if va <= 0 and d4 >= d3 and d5 >= d6:
        t = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return 0.0, 1.0 - t, t
    total = va + vb + vc
    if total <= 0:  # a needle without area
        return 1.0, 0.0, 0.0
    return va / total, vb / total, vc / total


@kernel
def descend(
    points: FloatArray,
    first: IntArray,
    vertices: FloatArray,
    faces: IntArray,
    star_start: IntArray,
    star_face: IntArray,
) -> tuple[IntArray, FloatArray]:
    """Closest points by descent over vertex stars, beginning at the vertices ``first``.

    Looks through the star of a vertex, then through the stars of the best face's corners, while
    that still comes closer. Returns faces (k,) and barycentric coordinates (k, 3).
    """
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
                    u, v, w = closest_on_triangle(
                        points[i], vertices[a], vertices[b], vertices[c]
                    )
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
