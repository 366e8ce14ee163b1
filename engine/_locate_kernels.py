"""Nearest point of a triangle set by descending a tree of boxes.

The tree is a complete binary one over runs of ``LEAF`` faces: node i has the children 2 i + 1 and
2 i + 2; a row of ``boxes`` (nodes, 6) is the box's lower and upper corner, inverted if empty.
Everything is in scalars: views of small arrays would cost more than the arithmetic.
"""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import ComplexArray, FloatArray, IntArray

LEAF = 2
MAX_DEPTH = 64

Vector = tuple[float, float, float]


@kernel
def _minus(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@kernel
def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def _on_segment(a: Vector, b: Vector) -> tuple[float, float]:
    """Squared distance of the origin to the segment a-b, and the weight of b."""
    side = _minus(b, a)
    length = _dot(side, side)
    along = -_dot(a, side)
    if along <= 0.0 or length == 0.0:
        return _dot(a, a), 0.0
    if along >= length:
        return _dot(b, b), 1.0
    t = along / length
    foot = a[0] + t * side[0], a[1] + t * side[1], a[2] + t * side[2]
    return _dot(foot, foot), t


@kernel
def nearest_on_triangle(a: Vector, b: Vector, c: Vector) -> tuple[float, Vector]:
    """Squared distance of the origin to the triangle a b c, and the barycentric weights.

    Where the origin is a corner its weight is exactly 1 and the distance exactly 0.
    """
    normal = _cross(_minus(b, a), _minus(c, a))
    square = _dot(normal, normal)
    if square > 0.0:
        wa, wb, wc = (
            _dot(_cross(b, c), normal),
            _dot(_cross(c, a), normal),
            _dot(_cross(a, b), normal),
        )
        if wa >= 0.0 and wb >= 0.0 and wc >= 0.0:
            height = _dot(a, normal)
            total = wa + wb + wc
            return height * height / square, (wa / total, wb / total, wc / total)
    best, t = _on_segment(a, b)
    weights = (1.0 - t, t, 0.0)
    far, t = _on_segment(b, c)
    if far < best:
        best, weights = far, (0.0, 1.0 - t, t)
    far, t = _on_segment(c, a)
    if far < best:
        best, weights = far, (t, 0.0, 1.0 - t)
    return best, weights


@kernel
def _box_distance(q: Vector, boxes: FloatArray, i: int) -> float:
    x = max(boxes[i, 0] - q[0], 0.0, q[0] - boxes[i, 3])
    y = max(boxes[i, 1] - q[1], 0.0, q[1] - boxes[i, 4])
    z = max(boxes[i, 2] - q[2], 0.0, q[2] - boxes[i, 5])
    return x * x + y * y + z * z


@kernel
def _to_face(q: Vector, corners: FloatArray, s: int) -> tuple[float, Vector]:
    a = corners[s, 0] - q[0], corners[s, 1] - q[1], corners[s, 2] - q[2]
    b = corners[s, 3] - q[0], corners[s, 4] - q[1], corners[s, 5] - q[2]
    c = corners[s, 6] - q[0], corners[s, 7] - q[1], corners[s, 8] - q[2]
    return nearest_on_triangle(a, b, c)


@kernel
def nearest_points(
    corners: FloatArray, order: IntArray, boxes: FloatArray, queries: FloatArray, sequence: IntArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Face, barycentric weights and squared distance of the nearest point to each query.

    ``corners`` (m, 9) and ``order`` list the faces as the tree's leaves hold them. Of faces at
    equal distance the lowest is given. Queries are taken in ``sequence`` (neighbours one after
    the other): the answer before bounds the next search and does not change its result.
    """
    face = np.empty(len(queries), dtype=np.int64)
    weights = np.empty((len(queries), 3))
    square = np.empty(len(queries))
    leaves = (len(boxes) + 1) // 2
    nodes = np.empty(MAX_DEPTH, dtype=np.int64)
    bounds = np.empty(MAX_DEPTH)
    slot = 0
    for i in sequence:
        q = queries[i, 0], queries[i, 1], queries[i, 2]
        best, chosen = _to_face(q, corners, slot)
        nodes[0], bounds[0], depth = 0, 0.0, 1
        while depth:
            depth -= 1
            if bounds[depth] > best:
                continue
            node = nodes[depth]
            if node < leaves - 1:
                near, far = 2 * node + 1, 2 * node + 2
                d_near, d_far = _box_distance(q, boxes, near), _box_distance(q, boxes, far)
                if d_far < d_near:
                    near, far, d_near, d_far = far, near, d_far, d_near
                if d_far <= best:
                    nodes[depth], bounds[depth] = far, d_far
                    depth += 1
                if d_near <= best:
                    nodes[depth], bounds[depth] = near, d_near
                    depth += 1
                continue
            start = (node - leaves + 1) * LEAF
            for s in range(start, min(start + LEAF, len(order))):
                distance, trial = _to_face(q, corners, s)
                if distance < best or (distance == best and order[s] < order[slot]):
                    best, chosen, slot = distance, trial, s
        face[i], square[i] = order[slot], best
        weights[i, 0], weights[i, 1], weights[i, 2] = chosen
    return face, weights, square


@kernel
def walked_to(
    z: ComplexArray,
    faces: IntArray,
    opposite: IntArray,
    queries: ComplexArray,
    start: IntArray,
    most: int,
    least: float,
) -> tuple[IntArray, FloatArray]:
    """The face that holds each of ``queries`` (k,), and weights, on foot from faces ``start`` (k,).

    From face to face over the side that a query is farthest beyond; ``opposite`` (3 m,)
    half-edges. -1 for those that ``most`` steps do not reach, that lead off the mesh, or whose
    weight is below ``least`` at a corner: they may be in several faces alike.
    """
    face = np.empty(len(queries), np.int64)
    weights = np.empty((len(queries), 3))
    for i in range(len(queries)):
        f, found = start[i], -1
        for _ in range(most):
            a = z[faces[f, 0]] - queries[i]
            b = z[faces[f, 1]] - queries[i]
            c = z[faces[f, 2]] - queries[i]
            wa = b.real * c.imag - b.imag * c.real
            wb = c.real * a.imag - c.imag * a.real
            wc = a.real * b.imag - a.imag * b.real
            total = wa + wb + wc
            if not total > 0.0:
                break
            if wa >= 0.0 and wb >= 0.0 and wc >= 0.0:
                weights[i, 0], weights[i, 1], weights[i, 2] = wa / total, wb / total, wc / total
                if min(wa, wb, wc) > least * total:
                    found = f
                break
            side = 1 if wa <= wb and wa <= wc else (2 if wb <= wc else 0)
            h = opposite[3 * f + side]
            if h < 0:
                break
            f = h // 3
        face[i] = found
    return face, weights
