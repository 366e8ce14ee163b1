"""Filters for exact predicates: what doubles decide, and what they leave open."""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import ComplexArray, FloatArray, IntArray


@kernel
def _orientation(z: ComplexArray, i: int, j: int, k: int) -> tuple[float, float]:
    """Twice the signed area of z_i z_j z_k, a bound of its rounding error (Shewchuk 1997)."""
    a, b, c = z[i], z[j], z[k]
    left = (a.real - c.real) * (b.imag - c.imag)
    right = (a.imag - c.imag) * (b.real - c.real)
    return left - right, 3.3306690738754716e-16 * (abs(left) + abs(right))


@kernel
def signed_areas(z: ComplexArray, faces: IntArray) -> tuple[FloatArray, FloatArray]:
    """Doubled signed areas (m,) and bounds (m,) of their rounding errors."""
    area = np.empty(len(faces))
    bound = np.empty(len(faces))
    for t in range(len(faces)):
        area[t], bound[t] = _orientation(z, int(faces[t, 0]), int(faces[t, 1]), int(faces[t, 2]))
    return area, bound


@kernel
def _apart(loop: ComplexArray, i: int, j: int) -> bool:
    """Whether edge j certainly lies strictly on one side of the line through edge i."""
    k = len(loop)
    first, first_bound = _orientation(loop, i, (i + 1) % k, j)
    second, second_bound = _orientation(loop, i, (i + 1) % k, (j + 1) % k)
    if abs(first) <= first_bound or abs(second) <= second_bound:
        return False
    return (first > 0.0) == (second > 0.0)


@kernel
def near_pairs(loop: ComplexArray) -> IntArray:
    """Pairs (p, 2) of edges of the polygon ``loop`` (k,) that doubles do not prove apart.

    Edge i leaves corner i. Neighbouring edges are listed where they may lie on one line.
    """
    k = len(loop)
    low, high = np.empty(k), np.empty(k)
    for i in range(k):
        low[i] = min(loop[i].real, loop[(i + 1) % k].real)
        high[i] = max(loop[i].real, loop[(i + 1) % k].real)
    order = np.argsort(low)
    found = [(0, 0) for _ in range(0)]
    for place in range(k):
        i = int(order[place])
        a, b = loop[i].imag, loop[(i + 1) % k].imag
        for other in range(place + 1, k):
            j = int(order[other])
            if low[j] > high[i]:
                break
            c, d = loop[j].imag, loop[(j + 1) % k].imag
            if min(a, b) > max(c, d) or min(c, d) > max(a, b):
                continue
            if (i + 1) % k == j or (j + 1) % k == i:
                start = i if (i + 1) % k == j else j
                area, bound = _orientation(loop, start, (start + 1) % k, (start + 2) % k)
                if abs(area) <= bound:
                    found.append((i, j))
            elif not _apart(loop, i, j) and not _apart(loop, j, i):
                found.append((i, j))
    pairs = np.empty((len(found), 2), np.int64)
    for p in range(len(found)):
        pairs[p, 0], pairs[p, 1] = found[p]
    return pairs
