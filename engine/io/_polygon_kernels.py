"""Compiled passes over polygons: ``corners`` (c,) listed one after the other, ``offsets`` (p + 1,).

What they name, they name the first of: as many as the array for it has room for.
"""

from __future__ import annotations

from engine._jit import kernel
from engine.types import BoolArray, IntArray


@kernel
def count_triangles(offsets: IntArray, thin: IntArray) -> tuple[int, int]:
    """Triangles of all fans, and how many polygons have fewer than 3 corners; names these."""
    triangles, count = 0, 0
    for polygon in range(len(offsets) - 1):
        size = offsets[polygon + 1] - offsets[polygon]
        triangles += max(size - 2, 0)
        if size < 3:
            if count < len(thin):
                thin[count] = polygon
            count += 1
    return triangles, count


@kernel
def bad_polygons(corners: IntArray, offsets: IntArray, vertex_count: int, bad: IntArray) -> int:
    """How many polygons have a corner that is no vertex; names them."""
    count = 0
    for polygon in range(len(offsets) - 1):
        for k in range(offsets[polygon], offsets[polygon + 1]):
            if corners[k] < 0 or corners[k] >= vertex_count:
                if count < len(bad):
                    bad[count] = polygon
                count += 1
                break
    return count


@kernel
def fan(corners: IntArray, offsets: IntArray, faces: IntArray) -> None:
    """Fill ``faces`` (m, 3): every polygon fanned from its first corner."""
    face = 0
    for polygon in range(len(offsets) - 1):
        first = offsets[polygon]
        for corner in range(first + 1, offsets[polygon + 1] - 1):
            faces[face, 0] = corners[first]
            faces[face, 1] = corners[corner]
            faces[face, 2] = corners[corner + 1]
            face += 1


@kernel
def unused_vertices(used: BoolArray, unused: IntArray) -> int:
    """How many vertices are not ``used`` (n,); names them."""
    count = 0
    for vertex in range(len(used)):
        if not used[vertex]:
            if count < len(unused):
                unused[count] = vertex
            count += 1
    return count


@kernel
def unroll_strips(items: IntArray, offsets: IntArray, triangles: IntArray) -> int:
    """Fill ``triangles`` (t, 3) from strips, as far as it has room; returns how many there are.

    Every second triangle of a strip runs the other way round. -1 starts a strip anew.
    """
    count = 0
    for strip in range(len(offsets) - 1):
        begin = offsets[strip]
        for k in range(offsets[strip], offsets[strip + 1]):
            if items[k] == -1:
                begin = k + 1
            elif k >= begin + 2:
                if count < len(triangles):
                    odd = (k - begin) % 2
                    triangles[count, 0] = items[k - 2 + odd]
                    triangles[count, 1] = items[k - 1 - odd]
                    triangles[count, 2] = items[k]
                count += 1
    return count
