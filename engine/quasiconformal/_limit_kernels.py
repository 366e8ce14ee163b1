"""Loops over the edges of a boundary polygon."""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import BoolArray, ComplexArray, IntArray


@kernel
def _side(a: complex, b: complex, c: complex) -> float:
    return (b.real - a.real) * (c.imag - a.imag) - (b.imag - a.imag) * (c.real - a.real)


@kernel
def crossing_edges(edges: ComplexArray) -> BoolArray:
    """(e,): which of the segments (e, 2) properly cross another one."""
    crossing = np.zeros(len(edges), np.bool_)
    for i in range(len(edges)):
        a, b = edges[i, 0], edges[i, 1]
        for j in range(i):
            c, d = edges[j, 0], edges[j, 1]
            if _side(a, b, c) * _side(a, b, d) < 0.0 and _side(c, d, a) * _side(c, d, b) < 0.0:
                crossing[i] = True
                crossing[j] = True
    return crossing


@kernel
def winding_numbers(edges: ComplexArray, points: ComplexArray) -> IntArray:
    """How often the closed polygon of directed ``edges`` (e, 2) runs around each of ``points``."""
    winding = np.zeros(len(points), np.int64)
    for k in range(len(points)):
        x = points[k]
        for e in range(len(edges)):
            a, b = edges[e, 0], edges[e, 1]
            if a.imag <= x.imag < b.imag and _side(a, b, x) > 0.0:
                winding[k] += 1
            elif b.imag <= x.imag < a.imag and _side(a, b, x) < 0.0:
                winding[k] -= 1
    return winding
