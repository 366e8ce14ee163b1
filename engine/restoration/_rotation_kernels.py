"""Compiled loops over vertices: edge covariances, nearest rotations, rotated differences."""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import FloatArray, IntArray

_LEAST_VOLUME = 1e-5  # determinant over the cube of the norm from which Newton's steps are few
_POLAR_STEPS = 12
_POLAR_NEAR = 1e-2  # squared change below which a scale no longer helps
_POLAR_DONE = 1e-15  # likewise: convergence is quadratic, so that what is left is rounding


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
    change = 1.0
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
        root = np.cbrt(det) if change > _POLAR_NEAR else 1.0
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
def nearest_rotation(S: FloatArray, R: FloatArray, N: FloatArray, q: FloatArray) -> None:
    """``R`` of one ``S`` (3, 3), as ``nearest_rotations``; ``N`` (4, 4), ``q`` (4,) are room."""
    if _polar_rotation(S, R):
        return
    xx, xy, xz = S[0, 0], S[1, 0], S[2, 0]
    yx, yy, yz = S[0, 1], S[1, 1], S[2, 1]
    zx, zy, zz = S[0, 2], S[1, 2], S[2, 2]
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
    R[0, 0] = 1.0 - 2.0 * (y * y + z * z)
    R[0, 1] = 2.0 * (x * y - w * z)
    R[0, 2] = 2.0 * (x * z + w * y)
    R[1, 0] = 2.0 * (x * y + w * z)
    R[1, 1] = 1.0 - 2.0 * (x * x + z * z)
    R[1, 2] = 2.0 * (y * z - w * x)
    R[2, 0] = 2.0 * (x * z - w * y)
    R[2, 1] = 2.0 * (y * z + w * x)
    R[2, 2] = 1.0 - 2.0 * (x * x + y * y)


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
        nearest_rotation(S[i], R[i], N, q)
    return R


@kernel
def upright_rotations(
    S: FloatArray, energy: FloatArray, before: FloatArray, after: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Rotations R (n, 3, 3) nearest to ``S`` and to what turns normals alike; trace(R^T S) (n,).

    The normals ``before`` (n, 3) and ``after`` weigh as much as ``energy`` (n,) says.
    """
    R = np.empty_like(S)
    size = np.empty(len(S))
    whole = np.empty((3, 3))
    N = np.empty((4, 4))
    q = np.empty(4)
    for i in range(len(S)):
        for a in range(3):
            for b in range(3):
                whole[a, b] = S[i, a, b] + energy[i] * after[i, a] * before[i, b]
        nearest_rotation(whole, R[i], N, q)
        size[i] = 0.0
        for a in range(3):
            for b in range(3):
                size[i] += R[i, a, b] * S[i, a, b]
    return R, size


@kernel
def edge_covariances(
    before: FloatArray, after: FloatArray, start: IntArray, neighbour: IntArray, weight: FloatArray
) -> FloatArray:
    """Per vertex (n, 9) sum w after_edge before_edge^T, row by row.

    ``start``, ``neighbour``, ``weight``: the one-rings in compressed rows.
    """
    out = np.zeros((len(before), 9))
    for i in range(len(before)):
        for k in range(start[i], start[i + 1]):
            j = neighbour[k]
            for b in range(3):
                e = weight[k] * (before[i, b] - before[j, b])
                for a in range(3):
                    out[i, 3 * a + b] += (after[i, a] - after[j, a]) * e
    return out


@kernel
def edge_energies(
    rest: FloatArray, start: IntArray, neighbour: IntArray, weight: FloatArray
) -> FloatArray:
    """Per vertex (n,) sum w |edge|^2; the one-rings as in ``edge_covariances``."""
    out = np.zeros(len(rest))
    for i in range(len(rest)):
        for k in range(start[i], start[i + 1]):
            for b in range(3):
                out[i] += weight[k] * (rest[i, b] - rest[neighbour[k], b]) ** 2
    return out


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


@kernel
def face_covariances(
    faces: IntArray, before: FloatArray, after: FloatArray, normal: FloatArray
) -> FloatArray:
    """Sums (n, 9) over each vertex's faces of how their sides and normals turn, row by row.

    after_side before_side^T over the sides of a face, plus 4 area after_normal before_normal^T;
    ``normal`` (m, 3) are the unit normals before.
    """
    out = np.zeros((len(before), 9))
    own = np.empty(9)
    for f in range(len(faces)):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        bx, by, bz = after[j, 0] - after[i, 0], after[j, 1] - after[i, 1], after[j, 2] - after[i, 2]
        cx, cy, cz = after[k, 0] - after[i, 0], after[k, 1] - after[i, 1], after[k, 2] - after[i, 2]
        up = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
        for a in range(3):
            for b in range(3):
                own[3 * a + b] = (
                    (after[j, a] - after[i, a]) * (before[j, b] - before[i, b])
                    + (after[k, a] - after[j, a]) * (before[k, b] - before[j, b])
                    + (after[i, a] - after[k, a]) * (before[i, b] - before[k, b])
                    + 2.0 * up[a] * normal[f, b]
                )
        for corner in range(3):
            v = faces[f, corner]
            for c in range(9):
                out[v, c] += own[c]
    return out
