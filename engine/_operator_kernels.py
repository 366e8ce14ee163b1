"""Compiled loops over faces: normals, areas, and their sums at vertices."""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import BoolArray, FloatArray, IntArray


@kernel
def doubled_normals(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """The cross product (m, 3) of two sides of each face."""
    out = np.empty((len(faces), 3))
    for f in range(len(faces)):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay, az = vertices[i, 0], vertices[i, 1], vertices[i, 2]
        bx, by, bz = vertices[j, 0] - ax, vertices[j, 1] - ay, vertices[j, 2] - az
        cx, cy, cz = vertices[k, 0] - ax, vertices[k, 1] - ay, vertices[k, 2] - az
        out[f, 0] = by * cz - bz * cy
        out[f, 1] = bz * cx - bx * cz
        out[f, 2] = bx * cy - by * cx
    return out


@kernel
def lengths(vectors: FloatArray) -> FloatArray:
    """The Euclidean length (m,) of each of ``vectors`` (m, 3)."""
    out = np.empty(len(vectors))
    for i in range(len(vectors)):
        x, y, z = vectors[i, 0], vectors[i, 1], vectors[i, 2]
        out[i] = np.sqrt(x * x + y * y + z * z)
    return out


@kernel
def normalise(vectors: FloatArray) -> None:
    """Give ``vectors`` (m, 3) length 1, in place; 0 stays."""
    for i in range(len(vectors)):
        x, y, z = vectors[i, 0], vectors[i, 1], vectors[i, 2]
        length = np.sqrt(x * x + y * y + z * z)
        if length > 0.0:
            vectors[i, 0] = x / length
            vectors[i, 1] = y / length
            vectors[i, 2] = z / length


@kernel
def sums_at_vertices(faces: IntArray, values: FloatArray, vertex_count: int) -> FloatArray:
    """The sum (n, c) of the ``values`` (m, c) of the faces at each vertex."""
    out = np.zeros((vertex_count, values.shape[1]))
    for f in range(len(faces)):
        for corner in range(3):
            for c in range(values.shape[1]):
                out[faces[f, corner], c] += values[f, c]
    return out


@kernel
def at_points(
    face: IntArray, barycentric: FloatArray, faces: IntArray, values: FloatArray
) -> FloatArray:
    """The ``values`` (n, c) of vertices, linearly at ``barycentric`` (k, 3) in ``face`` (k,)."""
    out = np.empty((len(face), values.shape[1]))
    for i in range(len(face)):
        a, b, c = faces[face[i], 0], faces[face[i], 1], faces[face[i], 2]
        u, v, w = barycentric[i, 0], barycentric[i, 1], barycentric[i, 2]
        for k in range(values.shape[1]):
            out[i, k] = u * values[a, k] + v * values[b, k] + w * values[c, k]
    return out


@kernel
def faces_within(chosen: BoolArray, faces: IntArray) -> BoolArray:
    """(m,) whether all corners of each of ``faces`` (m, 3) are ``chosen`` (n,)."""
    within = np.empty(len(faces), np.bool_)
    for f in range(len(faces)):
        within[f] = chosen[faces[f, 0]] and chosen[faces[f, 1]] and chosen[faces[f, 2]]
    return within


@kernel
def corners_at(faces: IntArray, vertex_count: int) -> tuple[IntArray, IntArray]:
    """Row starts (n + 1,) and the ascending faces around each vertex, once for each corner."""
    start = np.zeros(vertex_count + 1, np.int64)
    for f in range(len(faces)):
        for corner in range(3):
            start[faces[f, corner] + 1] += 1
    for i in range(vertex_count):
        start[i + 1] += start[i]
    around = np.empty(3 * len(faces), np.int64)
    fill = start[:-1].copy()
    for f in range(len(faces)):
        for corner in range(3):
            i = faces[f, corner]
            around[fill[i]] = f
            fill[i] += 1
    return start, around


@kernel
def one_rings(faces: IntArray, vertex_count: int) -> tuple[IntArray, IntArray]:
    """Row starts (n + 1,) and ascending neighbours of the vertices that share an edge."""
    start = np.zeros(vertex_count + 1, np.int64)
    for f in range(len(faces)):
        for corner in range(3):
            start[faces[f, corner] + 1] += 2
    for i in range(vertex_count):
        start[i + 1] += start[i]
    first = np.empty(start[-1], np.int64)
    fill = start[:-1].copy()
    for f in range(len(faces)):
        for corner in range(3):
            i = faces[f, corner]
            for step in range(1, 3):
                first[fill[i]] = faces[f, (corner + step) % 3]
                fill[i] += 1
    both = np.empty_like(first)  # transposing a symmetric pattern sorts its rows
    fill[:] = start[:-1]
    for i in range(vertex_count):
        for k in range(start[i], start[i + 1]):
            j = first[k]
            both[fill[j]] = i
            fill[j] += 1
    count = 0
    rows = np.zeros(vertex_count + 1, np.int64)
    for i in range(vertex_count):
        last = -1
        for k in range(start[i], start[i + 1]):
            j = both[k]
            if j not in (last, i):
                both[count] = last = j
                count += 1
        rows[i + 1] = count
    return rows, both[:count].copy()


@kernel
def ring_sums(values: FloatArray, start: IntArray, neighbour: IntArray, out: FloatArray) -> None:
    """The sum ``out`` (n, c) of the ``values`` (n, c) of each vertex and its neighbours."""
    for i in range(len(values)):
        row, own = out[i], values[i]
        for c in range(values.shape[1]):
            row[c] = own[c]
        for k in range(start[i], start[i + 1]):
            other = values[neighbour[k]]
            for c in range(values.shape[1]):
                row[c] += other[c]
