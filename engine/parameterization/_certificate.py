"""Whether positions in the plane are a bijection onto the disk, decided without rounding.

Let the faces of a disk with holes be laid out with positive areas, its outer boundary once around
the circle. The faces over a point are counted by how often the boundary winds around it: once for
the outer loop, less once for each hole that holds it if the holes run clockwise without meeting
themselves. A count is not negative, so no two holes hold the same point and every other point of
the disk lies under exactly one face.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from engine.parameterization._certificate_kernels import near_pairs, signed_areas
from engine.parameterization._frame import steps_around
from engine.types import ComplexArray, IntArray

Point = tuple[Fraction, Fraction]


def folded_faces(z: ComplexArray, faces: IntArray) -> IntArray:
    """Faces (k,) whose signed area is not positive; exact (rationals decide what doubles can't)."""
    area, bound = signed_areas(z, faces)
    doubtful = np.flatnonzero(np.abs(area) <= bound)
    folded = area < -bound
    for face in doubtful:
        folded[face] = _area(*_exact(z[faces[face]])) <= 0
    return np.flatnonzero(folded)


def folded_vertices(z: ComplexArray, faces: IntArray, holes: tuple[IntArray, ...]) -> IntArray:
    """Vertices (k,) of folded faces and of ``holes`` that are not simple and clockwise."""
    closed = [loop for loop in holes if not runs_clockwise(z[loop])]
    return np.concatenate([faces[folded_faces(z, faces)].ravel(), *closed])


def rim_turns_once(circle: ComplexArray) -> bool:
    """Whether boundary positions (b,) lie on the unit circle in order, strictly, once around."""
    if np.abs(np.abs(circle) - 1).max() > 1e-12:
        return False
    steps = steps_around(circle)
    return bool((steps > 0).all()) and abs(float(steps.sum()) - 2 * np.pi) < 1e-6


def runs_clockwise(loop: ComplexArray) -> bool:
    """Whether the polygon ``loop`` (k,) is simple and runs clockwise; exact."""
    points = _exact(loop)
    after = points[1:] + points[:1]
    doubled = sum(
        (x * v - y * u for (x, y), (u, v) in zip(points, after, strict=True)), Fraction(0)
    )
    if doubled >= 0:
        return False
    k = len(loop)
    for i, j in near_pairs(loop).tolist():
        if (i + 1) % k == j or (j + 1) % k == i:
            first, second = (i, j) if (i + 1) % k == j else (j, i)
            if _turns_back(points[first], points[second], after[second]):
                return False
        elif _meet(points[i], after[i], points[j], after[j]):
            return False
    return True


def _exact(z: ComplexArray) -> list[Point]:
    return [(Fraction(float(w.real)), Fraction(float(w.imag))) for w in z]


def _area(a: Point, b: Point, c: Point) -> Fraction:
    """Twice the signed area."""
    return (a[0] - c[0]) * (b[1] - c[1]) - (a[1] - c[1]) * (b[0] - c[0])


def _turns_back(a: Point, b: Point, c: Point) -> bool:
    """Whether the edges ab and bc share more than b."""
    along = (a[0] - b[0]) * (c[0] - b[0]) + (a[1] - b[1]) * (c[1] - b[1])
    return _area(a, b, c) == 0 and along > 0


def _meet(a: Point, b: Point, c: Point, d: Point) -> bool:
    """Whether the closed segments ab and cd share a point."""
    if any(max(a[x], b[x]) < min(c[x], d[x]) or max(c[x], d[x]) < min(a[x], b[x]) for x in (0, 1)):
        return False
    return _area(a, b, c) * _area(a, b, d) <= 0 and _area(c, d, a) * _area(c, d, b) <= 0
