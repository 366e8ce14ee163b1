"""Parts of a disk behind three edges, which harmonic maps shrink beyond what doubles tell apart.

A thin tube of such parts within each other shrinks by the same factor ring by ring. Straight lines
need not: any triangulation of n vertices can be drawn on a grid of 2n - 4 by n - 2.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from engine.operators import adjacency
from engine.types import ComplexArray, IntArray

Link = dict[tuple[int, int], int]
"""Of a side from vertex to vertex, what lies left of it."""


@dataclass(frozen=True, slots=True)
class Bubble:
    """The ``faces`` (k,) within a triangle of edges; its corners ``ring`` (3,) run around them."""

    faces: IntArray
    ring: IntArray


def bubbles(faces: IntArray, vertex_count: int, around: IntArray) -> list[Bubble]:
    """What lies behind three edges of a disk and has some of the faces ``around`` (j,) in it.

    Of those within each other the outermost.
    """
    sides = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).tolist()
    face_at: Link = {(a, b): number // 3 for number, (a, b) in enumerate(sides)}
    wanted = set(around.tolist())
    found = [
        (inside, ring)
        for ring in _triangles_without_face(faces, vertex_count, face_at)
        if (inside := _within(faces, face_at, ring)) & wanted
    ]
    found.sort(key=lambda one: len(one[0]), reverse=True)
    kept: list[tuple[set[int], IntArray]] = []
    for inside, ring in found:
        if not any(inside <= larger for larger, _ in kept):
            kept.append((inside, _turning_left(ring, inside, face_at)))
    return [Bubble(np.array(sorted(inside), dtype=np.int64), ring) for inside, ring in kept]


def _triangles_without_face(
    faces: IntArray, n: int, face_at: Link
) -> Iterator[tuple[int, int, int]]:
    """Three vertices, ascending, of which any two share an edge and that are no face."""
    near = adjacency(faces, n)
    common = sp.coo_array(sp.csr_array(near @ near).multiply(near))
    many = (common.data > 2) & (common.row < common.col)
    for a, b in zip(common.row[many].tolist(), common.col[many].tolist(), strict=True):
        both = set(_row(near, a)) & set(_row(near, b))
        beside = {face_at.get((a, b)), face_at.get((b, a))}
        here = {vertex for face in beside if face is not None for vertex in faces[face].tolist()}
        yield from ((a, b, c) for c in sorted(both - here) if c > b)


def _row(matrix: sp.csr_array, row: int) -> list[int]:
    return matrix.indices[matrix.indptr[row] : matrix.indptr[row + 1]].tolist()


def _within(faces: IntArray, face_at: Link, ring: tuple[int, int, int]) -> set[int]:
    """The fewer faces on one side of a triangle of edges; none if they are on the rim as well."""
    a, b, c = ring
    closed = {(a, b), (b, a), (b, c), (c, b), (c, a), (a, c)}
    sides = [_flooded(faces, face_at, closed, face_at[side]) for side in ((a, b), (b, a))]
    while True:
        for side in sides:
            try:
                next(side)
            except StopIteration as ended:
                return ended.value


def _flooded(
    faces: IntArray, face_at: Link, closed: set[tuple[int, int]], start: int
) -> Generator[None, None, set[int]]:
    """All faces that can be reached from one; pauses after each."""
    seen, todo, open_to_rim = {start}, [start], False
    while todo:
        a, b, c = faces[todo.pop()].tolist()
        for side in ((b, a), (c, b), (a, c)):
            if side in closed:
                continue
            other = face_at.get(side)
            if other is None:
                open_to_rim = True
            elif other not in seen:
                seen.add(other)
                todo.append(other)
        yield
    return set() if open_to_rim else seen


def _turning_left(ring: tuple[int, int, int], inside: set[int], face_at: Link) -> IntArray:
    a, b, c = ring
    return np.array((a, b, c) if face_at[a, b] in inside else (b, a, c), dtype=np.int64)


def drawn(faces: IntArray, ring: IntArray, corners: ComplexArray) -> tuple[IntArray, ComplexArray]:
    """The vertices (j,) within a triangle of edges, and where (j,) straight lines do not cross.

    ``faces`` (k, 3) fill the triangle ``ring`` (3,), whose ``corners`` (3,) turn left. By the shift
    method (de Fraysseix, Pach and Pollack, "How to draw a planar graph on a grid", 1990).
    """
    order, below = _canonical_order(faces, ring)
    grid = _shifted(order, below)
    at = np.array([grid[vertex] for vertex in order], dtype=np.complex128)
    width, (top_x, height) = at[1].real, (at[-1].real, at[-1].imag)
    up = at.imag / height
    along = (at.real - up * top_x) / width
    inside = np.array(order[2:-1], dtype=np.int64)
    a, b, c = corners
    return inside, (a + along * (b - a) + up * (c - a))[2:-1]


def _canonical_order(faces: IntArray, ring: IntArray) -> tuple[list[int], dict[int, list[int]]]:
    """The vertices so that each lies outside of all before it, and next to which of these.

    The neighbours are a path of the outer face of those before, from left to right.
    """
    third: Link = {}
    for a, b, c in faces.tolist():
        third[a, b], third[b, c], third[c, a] = c, a, b
    left, right, top = ring.tolist()
    outer = [left, top, right]
    order: list[int] = []
    below: dict[int, list[int]] = {}
    while len(outer) > 2:
        place = next(i for i in range(1, len(outer) - 1) if _is_free(third, outer, i))
        vertex = outer[place]
        below[vertex] = list(_fan(third, vertex, outer[place - 1], outer[place + 1]))
        order.append(vertex)
        outer[place : place + 1] = below[vertex][1:-1]
    return [left, right, *reversed(order)], below


def _is_free(third: Link, outer: list[int], place: int) -> bool:
    """Whether taking away a vertex of the outer face leaves it simple: it has no chord."""
    inside = list(_fan(third, outer[place], outer[place - 1], outer[place + 1]))[1:-1]
    return not set(inside) & set(outer)


def _fan(third: Link, vertex: int, left: int, right: int) -> Iterator[int]:
    """The neighbours of a vertex below it, from left to right."""
    yield left
    while left != right:
        left = third[vertex, left]
        yield left


def _shifted(order: list[int], below: dict[int, list[int]]) -> dict[int, complex]:
    """Grid points for a canonical ``order``: each new vertex moves what is right of it apart."""
    left, right = order[:2]
    at = {left: 0j, right: 2 + 0j}
    under = {vertex: [vertex] for vertex in order}
    outer = [left, right]
    for vertex in order[2:]:
        path = below[vertex]
        first, last = outer.index(path[0]), outer.index(path[-1])
        for moved in outer[first + 1 :]:
            by = 1 if outer.index(moved) < last else 2
            for one in under[moved]:
                at[one] += by
        p, q = at[path[0]], at[path[-1]]
        at[vertex] = complex(
            (p.real + q.real + q.imag - p.imag) / 2, (q.real - p.real + p.imag + q.imag) / 2
        )
        for covered in path[1:-1]:
            under[vertex] += under[covered]
        outer[first + 1 : last] = [vertex]
    return at
