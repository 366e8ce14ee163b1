"""Loops over the edges of a boundary polygon."""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import BoolArray, ComplexArray, IntArray


@kernel
def _side(a: complex, b: complex, c: complex) -> float:
    return (b.real - a.real) * (c.imag - a.imag) - (b.imag - a.imag) * (c.real - a.real)


@kernel
def _apart(a: float, b: float, c: float, d: float) -> bool:
    return max(a, b) < min(c, d) or max(c, d) < min(a, b)


@kernel
def crossing_edges(ends: IntArray, at: ComplexArray) -> BoolArray:
    """(e,): which segments between vertices ``ends`` (e, 2) at ``at`` (n,) meet another one.

    Segments with a common vertex meet when one doubles back along the other.
    """
    crossing = np.zeros(len(ends), np.bool_)
    for i in range(len(ends)):
        a, b = complex(at[ends[i, 0]]), complex(at[ends[i, 1]])
        for j in range(i):
            c, d = complex(at[ends[j, 0]]), complex(at[ends[j, 1]])
            if ends[i, 0] == ends[j, 1] or ends[i, 1] == ends[j, 0]:
                along = ((b - a) * (d - c).conjugate()).real
                turn = _side(a, b, c) if ends[i, 0] == ends[j, 1] else _side(a, b, d)
                meet = turn == 0.0 and along < 0.0
            elif _apart(a.real, b.real, c.real, d.real) or _apart(a.imag, b.imag, c.imag, d.imag):
                meet = False
            else:
                meet = (
                    _side(a, b, c) * _side(a, b, d) <= 0.0
                    and _side(c, d, a) * _side(c, d, b) <= 0.0
                )
            if meet:
                crossing[i] = True
                crossing[j] = True
    return crossing


@kernel
def winding_numbers(edges: ComplexArray, points: ComplexArray) -> IntArray:
    """How often the closed polygon of directed ``edges`` (e, 2) runs around each of ``points``."""
    winding = np.zeros(len(points), np.int64)
    for k in range(len(points)):
        x = complex(points[k])
        for e in range(len(edges)):
            a, b = complex(edges[e, 0]), complex(edges[e, 1])
            if a.imag <= x.imag < b.imag and _side(a, b, x) > 0.0:
                winding[k] += 1
            elif b.imag <= x.imag < a.imag and _side(a, b, x) < 0.0:
                winding[k] -= 1
    return winding
