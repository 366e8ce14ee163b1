"""Multifrontal Cholesky factorisation (Duff and Reid 1983; Liu 1992) of dense fronts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from engine._jit import fast_kernel
from engine.cholesky._blas import (
    LETTERS,
    MINUS,
    ONE,
    REALS,
    ZERO,
    L,
    N,
    R,
    T,
    potrf,
    syrk,
    trsm,
)
from engine.types import FloatArray, IntArray

_NARROW = 48  # columns that are eliminated here rather than by LAPACK
_LOW = 8  # rows below which BLAS takes longer to call than to work


@fast_kernel
def factor_fronts(
    data: FloatArray,
    first: IntArray,
    parent: IntArray,
    bound: IntArray,
    panel_at: IntArray,
    places: IntArray,
    inside: IntArray,
    update_at: IntArray,
    group: IntArray,
    entry: IntArray,
    target: IntArray,
    panels: FloatArray,
    work: FloatArray,
) -> tuple[int, float]:
    """Fill ``panels`` with the factor of ``data``; the arrays are those of ``Analysis``.

    Returns -1, or the first column whose pivot is not positive, and that pivot.
    """
    total = len(parent)
    child = np.full(total, -1, np.int64)
    following = np.full(total, -1, np.int64)
    numbers = np.zeros(4, np.int32)
    for s in range(total):
        k = first[s + 1] - first[s]
        u = bound[s + 1] - bound[s]
        m = k + u
        panel = panels[panel_at[s] : panel_at[s + 1]]
        panel[:] = 0.0
        for e in range(group[s], group[s + 1]):
            panel[target[e]] += data[entry[e]]
        c = child[s]
        while c >= 0:
            uc = bound[c + 1] - bound[c]
            update = work[update_at[c] : update_at[c] + uc * uc]
            _add(panel, m, 0, update, places[bound[c] : bound[c + 1]], 0, int(inside[c]))
            c = following[c]
        failed = _eliminate(panel, m, k) if k <= _NARROW else _eliminate_wide(panel, m, k, numbers)
        if failed >= 0:
            return first[s] + failed, float(panel[failed * m + failed])
        if u == 0:
            continue
        own = work[update_at[s] : update_at[s] + u * u]
        if u <= _LOW:
            _subtract_square(panel, m, k, own)
        else:
            _subtract_high_square(panel, m, k, own, numbers)
        c = child[s]
        while c >= 0:
            uc = bound[c + 1] - bound[c]
            update = work[update_at[c] : update_at[c] + uc * uc]
            _add(own, u, k, update, places[bound[c] : bound[c + 1]], int(inside[c]), int(uc))
            c = following[c]
        following[s] = child[parent[s]]
        child[parent[s]] = s
    return -1, 0.0


@fast_kernel
def _add(
    out: FloatArray,
    height: int,
    shift: int,
    update: FloatArray,
    place: IntArray,
    start: int,
    end: int,
) -> None:
    """Add columns ``start`` to ``end`` of a lower square to ``out``, of columns of ``height``.

    Its rows stand at ``place`` of the front, whose first ``shift`` rows and columns ``out`` lacks.
    """
    n = len(place)
    for j in range(start, end):
        base = (place[j] - shift) * height - shift
        for i in range(j, n):
            out[base + place[i]] += update[j * n + i]


@fast_kernel
def _eliminate(panel: FloatArray, m: int, k: int) -> int:
    """Cholesky of a narrow panel (m rows, k columns) in place; -1, or the failing column."""
    for a in range(0, k, 4):
        end = min(a + 4, k)
        for j in range(a, end):
            column = panel[j * m + j : (j + 1) * m]
            if not column[0] > 0.0:
                return j
            scale = 1.0 / np.sqrt(column[0])
            for i in range(len(column)):
                column[i] *= scale
            for t in range(j + 1, end):
                _subtract(panel[t * m + t : (t + 1) * m], column[t - j :])
        if end - a == 4:
            for t in range(end, k):
                _subtract_four(panel[t * m + t : (t + 1) * m], panel, a * m + t, m)
    return -1


@fast_kernel
def _subtract(out: FloatArray, column: FloatArray) -> None:
    """out -= column[0] column."""
    f = column[0]
    for i in range(len(out)):
        out[i] -= f * column[i]


@fast_kernel
def _subtract_four(out: FloatArray, panel: FloatArray, at: int, m: int) -> None:
    """``_subtract`` for four columns of a panel of m rows, the first from ``at`` on."""
    n = len(out)
    c0, c1 = panel[at : at + n], panel[at + m : at + m + n]
    c2, c3 = panel[at + 2 * m : at + 2 * m + n], panel[at + 3 * m : at + 3 * m + n]
    f0, f1, f2, f3 = c0[0], c1[0], c2[0], c3[0]
    for i in range(n):
        out[i] -= f0 * c0[i] + f1 * c1[i] + f2 * c2[i] + f3 * c3[i]


@fast_kernel
def _eliminate_wide(panel: FloatArray, m: int, k: int, numbers: NDArray[np.int32]) -> int:
    letter = LETTERS.ctypes.data
    lower, right, turned, plain = letter + L, letter + R, letter + T, letter + N
    numbers[:] = k, m, 0, m - k
    n = numbers.ctypes.data
    potrf(lower, n, panel.ctypes.data, n + 4, n + 8)
    if numbers[2]:
        return numbers[2] - 1
    if m > k:
        below = panel.ctypes.data + 8 * k
        trsm(
            right, lower, turned, plain, n + 12, n, REALS.ctypes.data + ONE,
            panel.ctypes.data, n + 4, below, n + 4,
        )  # fmt: skip
    return -1


@fast_kernel
def _subtract_high_square(
    panel: FloatArray, m: int, k: int, own: FloatArray, numbers: NDArray[np.int32]
) -> None:
    numbers[:] = m - k, k, m, 0
    n, letter, real = numbers.ctypes.data, LETTERS.ctypes.data, REALS.ctypes.data
    below = panel.ctypes.data + 8 * k
    syrk(
        letter + L, letter + N, n, n + 4, real + MINUS, below, n + 8,
        real + ZERO, own.ctypes.data, n,
    )  # fmt: skip


@fast_kernel
def _subtract_square(panel: FloatArray, m: int, k: int, own: FloatArray) -> None:
    """own = -L Lᵀ (lower) with L the panel's rows from k on."""
    u = m - k
    whole = k - k % 4
    for j in range(u):
        out = own[j * u + j : (j + 1) * u]
        out[:] = 0.0
        for a in range(0, whole, 4):
            _subtract_four(out, panel, a * m + k + j, m)
        for a in range(whole, k):
            _subtract(out, panel[a * m + k + j : (a + 1) * m])
