"""Compiled loops over vertices: edge covariances, nearest rotations, rotated differences."""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import FloatArray, IntArray

_LEAST_VOLUME = 1e-5  # determinant over the cube of the norm from which Newton's steps are few
_POLAR_STEPS = 12
_POLAR_DONE = 1e-20  # quadratic convergence: the step after this one would be below rounding


@kernel
def _largest_eigenvector(N: FloatArray, q: FloatArray) -> None:
    """Eigenvector ``q`` (4,) of the largest eigenvalue of symmetric ``N`` (4, 4), by Jacobi."""
    V = np.eye(4)
    for _ in range(30):
        off = 0.0
        size = 0.0
        for i in range(4):
            size += N[i, i] * N[i, i]
            for j in range(i + 1, 4):
                off += N[i, j] * N[i, j]
        if off <= 1e-32 * size:
            break
        for p in range(3):
            for r in range(p + 1, 4):
                if N[p, r] == 0.0:
                    continue
                h = 0.5 * (N[r, r] - N[p, p]) / N[p, r]
                t = 1.0 / (abs(h) + np.sqrt(h * h + 1.0))
                if h < 0.0:
                    t = -t
                c = 1.0 / np.sqrt(t * t + 1.0)
                s = t * c
                for k in range(4):
                    a = N[k, p]
                    b = N[k, r]
                    N[k, p] = c * a - s * b
                    N[k, r] = s * a + c * b
                for k in range(4):
                    a = N[p, k]
                    b = N[r, k]
                    N[p, k] = c * a - s * b
                    N[r, k] = s * a + c * b
                for k in range(4):
                    a = V[k, p]
                    b = V[k, r]
                    V[k, p] = c * a - s * b
                    V[k, r] = s * a + c * b
    best = 0
    for i in range(1, 4):
        if N[i, i] > N[best, best]:
            best = i
    for k in range(4):
        q[k] = V[k, best]


@kernel
def _polar_rotation(S: FloatArray, R: FloatArray) -> bool:
    """The rotation ``R`` (3, 3) next to ``S``, if that keeps orientation well enough to say.

    Newton's iteration for the polar factor with determinants as scales (Higham, 1986).
    """
    size = 0.0
    for a in range(3):
        for b in range(3):
            R[a, b] = S[a, b]
            size += S[a, b] * S[a, b]
    least = _LEAST_VOLUME * size * np.sqrt(size)
    for _ in range(_POLAR_STEPS):
        c00 = R[1, 1] * R[2, 2] - R[1, 2] * R[2, 1]
        c01 = R[1, 2] * R[2, 0] - R[1, 0] * R[2, 2]
        c02 = R[1, 0] * R[2, 1] - R[1, 1] * R[2, 0]
        det = R[0, 0] * c00 + R[0, 1] * c01 + R[0, 2] * c02
        if det <= least:
            return False
        least = 0.0
        c10 = R[0, 2] * R[2, 1] - R[0, 1] * R[2, 2]
        c11 = R[0, 0] * R[2, 2] - R[0, 2] * R[2, 0]
        c12 = R[0, 1] * R[2, 0] - R[0, 0] * R[2, 1]
        c20 = R[0, 1] * R[1, 2] - R[0, 2] * R[1, 1]
        c21 = R[0, 2] * R[1, 0] - R[0, 0] * R[1, 2]
        c22 = R[0, 0] * R[1, 1] - R[0, 1] * R[1, 0]
        root = det ** (1.0 / 3.0)
        p = 0.5 / root
        q = 0.5 * root / det
        change = 0.0
        for a, b, c in (
            (0, 0, c00), (0, 1, c01), (0, 2, c02),
            (1, 0, c10), (1, 1, c11), (1, 2, c12),
            (2, 0, c20), (2, 1, c21), (2, 2, c22),
        ):  # fmt: skip
            new = p * R[a, b] + q * c
            change += (new - R[a, b]) ** 2
            R[a, b] = new
        if change < _POLAR_DONE:
            return True
    return False


@kernel
def nearest_rotations(S: FloatArray) -> FloatArray:
    """Rotations R (n, 3, 3) maximising trace(R^T S) for each ``S`` (n, 3, 3) = sum after before^T.

    Polar factors where ``S`` keeps orientation; else Horn, "Closed-form solution of absolute
    orientation using unit quaternions", 1987: proper also where S is of rank 2 or reverses it.
    """
    R = np.empty_like(S)
    N = np.empty((4, 4))
    q = np.empty(4)
    for i in range(len(S)):
        if _polar_rotation(S[i], R[i]):
            continue
        xx, xy, xz = S[i, 0, 0], S[i, 1, 0], S[i, 2, 0]
        yx, yy, yz = S[i, 0, 1], S[i, 1, 1], S[i, 2, 1]
        zx, zy, zz = S[i, 0, 2], S[i, 1, 2], S[i, 2, 2]
        N[0, 0] = xx + yy + zz
        N[1, 1] = xx - yy - zz
        N[2, 2] = yy - xx - zz
        N[3, 3] = zz - xx - yy
        N[0, 1] = N[1, 0] = yz - zy
        N[0, 2] = N[2, 0] = zx - xz
        N[0, 3] = N[3, 0] = xy - yx
        N[1, 2] = N[2, 1] = xy + yx
        N[1, 3] = N[3, 1] = zx + xz
        N[2, 3] = N[3, 2] = yz + zy
        _largest_eigenvector(N, q)
        w, x, y, z = q[0], q[1], q[2], q[3]
        R[i, 0, 0] = 1.0 - 2.0 * (y * y + z * z)
        R[i, 0, 1] = 2.0 * (x * y - w * z)
        R[i, 0, 2] = 2.0 * (x * z + w * y)
        R[i, 1, 0] = 2.0 * (x * y + w * z)
        R[i, 1, 1] = 1.0 - 2.0 * (x * x + z * z)
        R[i, 1, 2] = 2.0 * (y * z - w * x)
        R[i, 2, 0] = 2.0 * (x * z - w * y)
        R[i, 2, 1] = 2.0 * (y * z + w * x)
        R[i, 2, 2] = 1.0 - 2.0 * (x * x + y * y)
    return R


@kernel
def edge_covariances(
    before: FloatArray, after: FloatArray, start: IntArray, neighbour: IntArray, weight: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Per vertex sum w after_edge before_edge^T (n, 3, 3) and sum w |before_edge|^2 (n,).

    ``start``, ``neighbour``, ``weight``: the one-rings in compressed rows.
    """
    n = len(before)
    S = np.zeros((n, 3, 3))
    energy = np.zeros(n)
    for i in range(n):
        for k in range(start[i], start[i + 1]):
            j = neighbour[k]
            for b in range(3):
                e = weight[k] * (before[i, b] - before[j, b])
                energy[i] += e * (before[i, b] - before[j, b])
                for a in range(3):
                    S[i, a, b] += (after[i, a] - after[j, a]) * e
    return S, energy


@kernel
def turned_edges(
    before: FloatArray, T: FloatArray, start: IntArray, neighbour: IntArray, weight: FloatArray
) -> FloatArray:
    """Per vertex sum w (T_i + T_j)/2 before_edge (n, 3): the right side of a local/global step."""
    n = len(before)
    out = np.zeros((n, 3))
    for i in range(n):
        for k in range(start[i], start[i + 1]):
            j = neighbour[k]
            for b in range(3):
                e = 0.5 * weight[k] * (before[i, b] - before[j, b])
                for a in range(3):
                    out[i, a] += (T[i, a, b] + T[j, a, b]) * e
    return out
