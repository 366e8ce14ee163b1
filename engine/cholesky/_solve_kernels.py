"""Triangular solves with the panels of a supernodal factor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from engine._jit import fast_kernel
from engine.cholesky._blas import LETTERS, MINUS, ONE, REALS, ZERO, L, N, T, gemm, trsm
from engine.types import FloatArray, IntArray

_MANY = 6  # right-hand sides from which BLAS pays


@fast_kernel
def solve_fronts(
    panels: FloatArray,
    order: IntArray,
    first: IntArray,
    bound: IntArray,
    rows: IntArray,
    panel_at: IntArray,
    right: FloatArray,
) -> FloatArray:
    """The solutions (n, r) for right-hand sides ``right`` (n, r)."""
    n, count = right.shape
    x = np.empty((count, n))
    for i in range(n):
        for r in range(count):
            x[r, i] = right[order[i], r]
    most = 0
    for s in range(len(first) - 1):
        most = max(most, bound[s + 1] - bound[s])
    below = np.empty((max(count, 2), most))
    numbers = np.zeros(6, np.int32)
    for s in range(len(first) - 1):
        panel = panels[panel_at[s] : panel_at[s + 1]]
        under = rows[bound[s] : bound[s + 1]]
        _forward(panel, first[s], first[s + 1] - first[s], under, x, below, numbers)
    for s in range(len(first) - 2, -1, -1):
        panel = panels[panel_at[s] : panel_at[s + 1]]
        under = rows[bound[s] : bound[s + 1]]
        _backward(panel, first[s], first[s + 1] - first[s], under, x, below, numbers)
    answer = np.empty((n, count))
    for i in range(n):
        for r in range(count):
            answer[order[i], r] = x[r, i]
    return answer


@fast_kernel
def _forward(
    panel: FloatArray,
    a: int,
    k: int,
    under: IntArray,
    x: FloatArray,
    below: FloatArray,
    numbers: NDArray[np.int32],
) -> None:
    if len(x) >= _MANY:
        _forward_many(panel, a, k, under, x, below, numbers)
        return
    for r in range(0, len(x) - 1, 2):
        _forward_two(panel, a, k, under, x[r], x[r + 1], below)
    if len(x) % 2:
        _forward_one(panel, a, k, under, x[-1], below[0])


@fast_kernel
def _backward(
    panel: FloatArray,
    a: int,
    k: int,
    under: IntArray,
    x: FloatArray,
    below: FloatArray,
    numbers: NDArray[np.int32],
) -> None:
    if len(x) >= _MANY:
        _backward_many(panel, a, k, under, x, below, numbers)
        return
    for r in range(0, len(x) - 1, 2):
        _backward_two(panel, a, k, under, x[r], x[r + 1], below)
    if len(x) % 2:
        _backward_one(panel, a, k, under, x[-1], below[0])


@fast_kernel
def _forward_one(
    panel: FloatArray, a: int, k: int, under: IntArray, x: FloatArray, below: FloatArray
) -> None:
    u = len(under)
    m = k + u
    own, sums = x[a : a + k], below[:u]
    sums[:] = 0.0
    for j in range(k):
        column = panel[j * m : j * m + k]
        f = own[j] / column[j]
        own[j] = f
        rest, entries = own[j + 1 :], column[j + 1 :]
        for i in range(len(rest)):
            rest[i] -= f * entries[i]
        lower = panel[j * m + k : (j + 1) * m]
        for i in range(u):
            sums[i] += f * lower[i]
    for i in range(u):
        x[under[i]] -= sums[i]


@fast_kernel
def _forward_two(
    panel: FloatArray,
    a: int,
    k: int,
    under: IntArray,
    x: FloatArray,
    y: FloatArray,
    below: FloatArray,
) -> None:
    """Both at once: it is reading the panel that takes the time."""
    u = len(under)
    m = k + u
    own, other, sums, others = x[a : a + k], y[a : a + k], below[0, :u], below[1, :u]
    sums[:] = 0.0
    others[:] = 0.0
    for j in range(k):
        column = panel[j * m : j * m + k]
        f, g = own[j] / column[j], other[j] / column[j]
        own[j], other[j] = f, g
        rest, rests, entries = own[j + 1 :], other[j + 1 :], column[j + 1 :]
        for i in range(len(entries)):
            rest[i] -= f * entries[i]
            rests[i] -= g * entries[i]
        lower = panel[j * m + k : (j + 1) * m]
        for i in range(u):
            sums[i] += f * lower[i]
            others[i] += g * lower[i]
    for i in range(u):
        x[under[i]] -= sums[i]
        y[under[i]] -= others[i]


@fast_kernel
def _backward_one(
    panel: FloatArray, a: int, k: int, under: IntArray, x: FloatArray, below: FloatArray
) -> None:
    u = len(under)
    m = k + u
    own, found = x[a : a + k], below[:u]
    for i in range(u):
        found[i] = x[under[i]]
    for j in range(k - 1, -1, -1):
        lower = panel[j * m + k : (j + 1) * m]
        total = own[j]
        for i in range(u):
            total -= lower[i] * found[i]
        rest, entries = own[j + 1 :], panel[j * m + j + 1 : j * m + k]
        for i in range(len(rest)):
            total -= entries[i] * rest[i]
        own[j] = total / panel[j * m + j]


@fast_kernel
def _backward_two(
    panel: FloatArray,
    a: int,
    k: int,
    under: IntArray,
    x: FloatArray,
    y: FloatArray,
    below: FloatArray,
) -> None:
    u = len(under)
    m = k + u
    own, other, found, others = x[a : a + k], y[a : a + k], below[0, :u], below[1, :u]
    for i in range(u):
        found[i], others[i] = x[under[i]], y[under[i]]
    for j in range(k - 1, -1, -1):
        lower = panel[j * m + k : (j + 1) * m]
        total, second = own[j], other[j]
        for i in range(u):
            total -= lower[i] * found[i]
            second -= lower[i] * others[i]
        rest, rests = own[j + 1 :], other[j + 1 :]
        entries = panel[j * m + j + 1 : j * m + k]
        for i in range(len(entries)):
            total -= entries[i] * rest[i]
            second -= entries[i] * rests[i]
        own[j], other[j] = total / panel[j * m + j], second / panel[j * m + j]


@fast_kernel
def _sizes(numbers: NDArray[np.int32], k: int, u: int, x: FloatArray, below: FloatArray) -> int:
    """The address of k, r, the panel's rows, n, u and the stride of ``below``."""
    numbers[:] = k, len(x), k + u, x.shape[1], u, below.shape[1]
    return int(numbers.ctypes.data)


@fast_kernel
def _forward_many(
    panel: FloatArray,
    a: int,
    k: int,
    under: IntArray,
    x: FloatArray,
    below: FloatArray,
    numbers: NDArray[np.int32],
) -> None:
    u = len(under)
    letter, real = LETTERS.ctypes.data, REALS.ctypes.data
    lower, plain, one, zero = letter + L, letter + N, real + ONE, real + ZERO
    n, own = _sizes(numbers, k, u, x, below), x.ctypes.data + 8 * a
    trsm(lower, lower, plain, plain, n, n + 4, one, panel.ctypes.data, n + 8, own, n + 12)
    if u:
        entries = panel.ctypes.data + 8 * k
        gemm(
            plain, plain, n + 16, n + 4, n, one, entries, n + 8, own, n + 12,
            zero, below.ctypes.data, n + 20,
        )  # fmt: skip
        for r in range(len(x)):
            for i in range(u):
                x[r, under[i]] -= below[r, i]


@fast_kernel
def _backward_many(
    panel: FloatArray,
    a: int,
    k: int,
    under: IntArray,
    x: FloatArray,
    below: FloatArray,
    numbers: NDArray[np.int32],
) -> None:
    u = len(under)
    letter, real = LETTERS.ctypes.data, REALS.ctypes.data
    lower, plain, turned, one = letter + L, letter + N, letter + T, real + ONE
    n, own = _sizes(numbers, k, u, x, below), x.ctypes.data + 8 * a
    if u:
        for r in range(len(x)):
            for i in range(u):
                below[r, i] = x[r, under[i]]
        entries = panel.ctypes.data + 8 * k
        gemm(
            turned, plain, n, n + 4, n + 16, real + MINUS, entries, n + 8,
            below.ctypes.data, n + 20, one, own, n + 12,
        )  # fmt: skip
    trsm(lower, lower, turned, plain, n, n + 4, one, panel.ctypes.data, n + 8, own, n + 12)
