"""Per-element loops behind :mod:`engine.nearest`."""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import BoolArray, FloatArray, IntArray

Triple = tuple[float, float, float]


@kernel
def closest_on_triangle(a: Triple, b: Triple, c: Triple) -> Triple:
    """Barycentric coordinates of the point of triangle abc closest to 0 (Ericson 2005, 5.1.5)."""
    abx, aby, abz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    acx, acy, acz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    d1 = -(abx * a[0] + aby * a[1] + abz * a[2])
    d2 = -(acx * a[0] + acy * a[1] + acz * a[2])
    d3 = -(abx * b[0] + aby * b[1] + abz * b[2])
    d4 = -(acx * b[0] + acy * b[1] + acz * b[2])
    d5 = -(abx * c[0] + aby * c[1] + abz * c[2])
    d6 = -(acx * c[0] + acy * c[1] + acz * c[2])
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
    that still comes closer; no face twice. Returns faces (k,) and barycentric coordinates (k, 3).
    """
    star_start, star_face = star
    count = len(points)
    face = np.zeros(count, np.int64)
    barycentric = np.zeros((count, 3))
    queue = np.zeros(3, np.int64)
    done = np.zeros(10, np.int64)
    for i in range(count):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        best = np.inf
        queue[0] = first[i]
        waiting = 1
        stars = 0
        for _ in range(4):
            closer = False
            for q in range(waiting):
                centre = queue[q]
                if among(centre, done, stars):
                    continue
                for s in range(star_start[centre], star_start[centre + 1]):
                    f = star_face[s]
                    a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
                    if among(a, done, stars) or among(b, done, stars) or among(c, done, stars):
                        continue
                    A = vertices[a, 0] - x, vertices[a, 1] - y, vertices[a, 2] - z
                    B = vertices[b, 0] - x, vertices[b, 1] - y, vertices[b, 2] - z
                    C = vertices[c, 0] - x, vertices[c, 1] - y, vertices[c, 2] - z
                    u, v, w = closest_on_triangle(A, B, C)
                    d = 0.0
                    for k in range(3):
                        d += (u * A[k] + v * B[k] + w * C[k]) ** 2
                    if d < best * (1 - 1e-12):
                        best = d
                        face[i] = f
                        barycentric[i, 0] = u
                        barycentric[i, 1] = v
                        barycentric[i, 2] = w
                        closer = True
                done[stars] = centre
                stars += 1
            if not closer:
                break
            for k in range(3):
                queue[k] = faces[face[i], k]
            waiting = 3
    return face, barycentric


@kernel
def among(vertex: int, chosen: IntArray, count: int) -> bool:
    """Whether ``vertex`` is one of the first ``count`` that were ``chosen``."""
    found = False
    for k in range(count):
        found |= chosen[k] == vertex
    return found


@kernel
def described(
    points: FloatArray,
    face: IntArray,
    barycentric: FloatArray,
    vertices: FloatArray,
    normals: FloatArray,
    faces: IntArray,
    border: BoolArray,
) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
    """Positions (k, 3) of feet, unit normals (k, 3), distances (k,) from the points, on_border.

    ``normals`` (n, 3) of the vertices are interpolated; a foot is on the border when only
    ``border`` vertices (n,) carry it.
    """
    count = len(points)
    position, normal = np.zeros((count, 3)), np.zeros((count, 3))
    distance, on_border = np.zeros(count), np.ones(count, np.bool_)
    for i in range(count):
        for corner in range(3):
            weight = barycentric[i, corner]
            vertex = faces[face[i], corner]
            if weight > 1e-6 and not border[vertex]:
                on_border[i] = False
            for k in range(3):
                position[i, k] += weight * vertices[vertex, k]
                normal[i, k] += weight * normals[vertex, k]
        gap, length = 0.0, 0.0
        for k in range(3):
            gap += (points[i, k] - position[i, k]) ** 2
            length += normal[i, k] ** 2
        distance[i] = np.sqrt(gap)
        length = max(np.sqrt(length), 1e-300)
        for k in range(3):
            normal[i, k] /= length
    return position, normal, distance, on_border
