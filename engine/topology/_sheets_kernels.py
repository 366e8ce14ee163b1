"""Compiled choice of the two sheets that belong together where more than two meet at an edge."""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import FloatArray, IntArray

COMPARED = 16
"""Sheets at one edge that are compared with each other: those of the largest pieces."""


@kernel
def best_pairs(
    start: IntArray, normals: FloatArray, weight: FloatArray, crowded: IntArray, ends: IntArray
) -> IntArray:
    """(g, 2) the half-edges to join of each group ``crowded[ends[i]:ends[i + 1]]`` on one edge.

    The pair of largest ``weight`` (m,) of the faces (the heavier counts first), then one that is
    turned alike, then the one that bends least. ``start`` (3m,) are the half-edges' origins.
    """
    pairs = np.empty((len(ends) - 1, 2), dtype=np.int64)
    near = np.empty(COMPARED, dtype=np.int64)
    for group in range(len(pairs)):
        count = heaviest(weight, crowded, ends[group], ends[group + 1], near)
        first = True
        best = (0.0, 0.0, 0, 0.0)
        for i in range(count):
            for j in range(i + 1, count):
                f, g = near[i] // 3, near[j] // 3
                alike = start[near[i]] != start[near[j]]
                bend = cosine(normals[f], normals[g])
                merit = (weight[f], weight[g], int(alike), bend if alike else -bend)
                if first or merit > best:
                    first, best = False, merit
                    pairs[group, 0], pairs[group, 1] = near[i], near[j]
    return pairs


@kernel
def heaviest(weight: FloatArray, crowded: IntArray, begin: int, end: int, found: IntArray) -> int:
    """How many of the half-edges ``crowded[begin:end]`` go into ``found``, the heaviest first."""
    count = 0
    for k in range(begin, end):
        at = count
        while at > 0 and weight[crowded[k] // 3] > weight[found[at - 1] // 3]:
            at -= 1
        if at < len(found):
            count = min(count + 1, len(found))
            for back in range(count - 1, at, -1):
                found[back] = found[back - 1]
            found[at] = crowded[k]
    return count


@kernel
def cosine(a: FloatArray, b: FloatArray) -> float:
    """Of the angle between two vectors, to single precision; 0 if one is 0."""
    squares = (a[0] ** 2 + a[1] ** 2 + a[2] ** 2) * (b[0] ** 2 + b[1] ** 2 + b[2] ** 2)
    dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return float(np.float32(dot / np.sqrt(squares))) if squares > 0.0 else 0.0


@kernel
def face_vector(vertices: FloatArray, faces: IntArray, face: int) -> tuple[float, float, float]:
    """The normal of a face, of twice its area in length."""
    a, b, c = vertices[faces[face, 0]], vertices[faces[face, 1]], vertices[faces[face, 2]]
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@kernel
def face_vectors(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Normals (m, 3) of twice the face's area in length."""
    vectors = np.empty((len(faces), 3))
    for face in range(len(faces)):
        vectors[face, 0], vectors[face, 1], vectors[face, 2] = face_vector(vertices, faces, face)
    return vectors


@kernel
def face_areas(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """(m,)"""
    areas = np.empty(len(faces))
    for face in range(len(faces)):
        x, y, z = face_vector(vertices, faces, face)
        areas[face] = 0.5 * np.sqrt(x * x + y * y + z * z)
    return areas
