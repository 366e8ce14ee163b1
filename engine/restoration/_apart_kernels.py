"""Compiled loops over faces: shapes taken apart into rotations and stretches."""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.restoration._frames import Frames
from engine.restoration._rotation_kernels import nearest_rotation
from engine.types import FloatArray, IntArray

Vector = tuple[float, float, float]

_FLAT = 1e-4  # of a face's squared size: with less area, its stretch is not inverted


@kernel
def rotations_and_stretches(
    faces: IntArray, frames: Frames, shape: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """How each face goes to ``shape`` (n, 3): rotations (m, 3, 3), stretches, their mean (3, 3).

    The polar factors of each face's deformation gradient. A normal goes to the normal, stretched
    as sides are on average. Stretches (m, 3) are S_uu, S_uv, S_vv of the right factor in the
    face's own plane; the mean is that of the gradients, weighed by area.
    """
    rotations = np.empty((len(faces), 3, 3))
    mean = np.zeros((3, 3))
    S = np.empty((len(faces), 3))
    full = np.empty((3, 3))
    N = np.empty((4, 4))
    q = np.empty(4)
    for f in range(len(faces)):
        u, v = _images(faces[f], frames.hats[f], shape)
        n = u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]
        area = np.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
        size = np.sqrt(area) if area > 0.0 else 1.0
        T = frames.tangents[f]
        _join(u, v, (n[0] / size, n[1] / size, n[2] / size), T, full)
        for a in range(3):
            for c in range(3):
                mean[a, c] += frames.areas[f] * full[a, c]
        s = S[f]
        _stretch(u[0] * u[0] + u[1] * u[1] + u[2] * u[2], u[0] * v[0] + u[1] * v[1] + u[2] * v[2],
                 v[0] * v[0] + v[1] * v[1] + v[2] * v[2], s)  # fmt: skip
        if area > _FLAT * (s[0] + s[2]) ** 2:
            p, r, t = s[2] / area, s[1] / area, s[0] / area
            u, v = (
                (p * u[0] - r * v[0], p * u[1] - r * v[1], p * u[2] - r * v[2]),
                (t * v[0] - r * u[0], t * v[1] - r * u[1], t * v[2] - r * u[2]),
            )
            _join(u, v, (n[0] / area, n[1] / area, n[2] / area), T, rotations[f])
        else:
            nearest_rotation(full, rotations[f], N, q)
    return rotations, S, mean


@kernel
def _images(face: IntArray, hats: FloatArray, shape: FloatArray) -> tuple[Vector, Vector]:
    """Where the two tangents of one face go."""
    ux = uy = uz = vx = vy = vz = 0.0
    for corner in range(3):
        i = face[corner]
        p, q = hats[corner, 0], hats[corner, 1]
        x, y, z = shape[i, 0], shape[i, 1], shape[i, 2]
        ux, uy, uz = ux + x * p, uy + y * p, uz + z * p
        vx, vy, vz = vx + x * q, vy + y * q, vz + z * q
    return (ux, uy, uz), (vx, vy, vz)


@kernel
def _join(u: Vector, v: Vector, n: Vector, T: FloatArray, out: FloatArray) -> None:
    """The matrix ``out`` (3, 3) that takes the tangents ``T`` (3, 2) and their normal to three."""
    across = (
        T[1, 0] * T[2, 1] - T[2, 0] * T[1, 1],
        T[2, 0] * T[0, 1] - T[0, 0] * T[2, 1],
        T[0, 0] * T[1, 1] - T[1, 0] * T[0, 1],
    )
    for a in range(3):
        for c in range(3):
            out[a, c] = u[a] * T[c, 0] + v[a] * T[c, 1] + n[a] * across[c]


@kernel
def _stretch(a: float, b: float, c: float, S: FloatArray) -> None:
    """The root ``S`` (uu, uv, vv) of the symmetric 2 x 2 matrix ``a``, ``b``, ``c``."""
    s = np.sqrt(max(a * c - b * b, 0.0))
    t = np.sqrt(a + c + 2.0 * s)
    if t > 0.0:
        S[0] = (a + s) / t
        S[1] = b / t
        S[2] = (c + s) / t
    else:
        S[:] = 0.0


@kernel
def least_stretches(stretch: FloatArray) -> FloatArray:
    """The smaller principal stretch (m,) of each face, least among shapes (k, m, 3)."""
    out = np.full(stretch.shape[1], np.inf)
    for k in range(len(stretch)):
        for f in range(stretch.shape[1]):
            uu, uv, vv = stretch[k, f, 0], stretch[k, f, 1], stretch[k, f, 2]
            half = 0.5 * (uu - vv)
            out[f] = min(out[f], 0.5 * (uu + vv) - np.sqrt(half * half + uv * uv))
    return out


@kernel
def relative_rotations(common: FloatArray, R: FloatArray) -> FloatArray:
    """``common``^T R for each ``R`` (m, 3, 3)."""
    out = np.empty_like(R)
    for f in range(len(R)):
        for a in range(3):
            for c in range(3):
                out[f, a, c] = (
                    common[0, a] * R[f, 0, c]
                    + common[1, a] * R[f, 1, c]
                    + common[2, a] * R[f, 2, c]
                )
    return out


@kernel
def rotation_logarithms(R: FloatArray) -> FloatArray:
    """Rotation vectors (m, 3), angle in [0, pi], of rotations ``R`` (m, 3, 3)."""
    out = np.empty((len(R), 3))
    q = np.empty(4)
    for f in range(len(R)):
        A = R[f]
        trace = A[0, 0] + A[1, 1] + A[2, 2]
        if trace > 0.0:
            q[0] = 1.0 + trace
            q[1] = A[2, 1] - A[1, 2]
            q[2] = A[0, 2] - A[2, 0]
            q[3] = A[1, 0] - A[0, 1]
        else:
            i = 0
            if A[1, 1] > A[i, i]:
                i = 1
            if A[2, 2] > A[i, i]:
                i = 2
            j = (i + 1) % 3
            k = (i + 2) % 3
            q[0] = A[k, j] - A[j, k]
            q[1 + i] = 1.0 + A[i, i] - A[j, j] - A[k, k]
            q[1 + j] = A[j, i] + A[i, j]
            q[1 + k] = A[k, i] + A[i, k]
        if q[0] < 0.0:
            q[:] = -q
        s = np.sqrt(q[1] ** 2 + q[2] ** 2 + q[3] ** 2)
        factor = 2.0 * np.arctan2(s, q[0]) / s if s > 0.0 else 0.0
        out[f, 0] = factor * q[1]
        out[f, 1] = factor * q[2]
        out[f, 2] = factor * q[3]
    return out


@kernel
def unwrap_rotations(omega: FloatArray, neighbours: IntArray, sure: float) -> None:
    """Give rotation vectors longer than ``sure`` the branch next to their neighbours', in place.

    ``neighbours`` (m, 3) faces across the edges, -1 at the boundary. Branches spread breadth
    first from the faces turned by less than ``sure``, whose branch is beyond doubt.
    """
    m = len(omega)
    queue = np.empty(m, np.int64)
    known = np.zeros(m, np.bool_)
    tail = 0
    for f in range(m):
        if omega[f, 0] ** 2 + omega[f, 1] ** 2 + omega[f, 2] ** 2 < sure * sure:
            known[f] = True
            queue[tail] = f
            tail += 1
    head = 0
    while head < tail:
        f = queue[head]
        head += 1
        for c in range(3):
            g = neighbours[f, c]
            if g < 0 or known[g]:
                continue
            known[g] = True
            queue[tail] = g
            tail += 1
            angle = np.sqrt(omega[g, 0] ** 2 + omega[g, 1] ** 2 + omega[g, 2] ** 2)
            dot = omega[g, 0] * omega[f, 0] + omega[g, 1] * omega[f, 1] + omega[g, 2] * omega[f, 2]
            turns = np.rint((dot / angle - angle) / (2.0 * np.pi))
            for k in range(3):
                omega[g, k] *= 1.0 + 2.0 * np.pi * turns / angle
