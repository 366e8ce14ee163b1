"""Compiled loops over faces: shapes taken apart into rotations and stretches."""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.restoration._frames import Frames
from engine.types import FloatArray, IntArray


@kernel
def deformation_gradients(
    faces: IntArray, frames: Frames, shape: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """How each face goes to ``shape`` (n, 3): gradients (m, 3, 3), their mean (3, 3), stretches.

    A normal goes to the normal, stretched as sides are on average. Stretches (m, 3) are S_uu,
    S_uv, S_vv of the right polar factor in the face's own plane; the mean weighs by area.
    """
    full = np.empty((len(faces), 3, 3))
    mean = np.zeros((3, 3))
    S = np.empty((len(faces), 3))
    for f in range(len(faces)):
        ux = uy = uz = vx = vy = vz = 0.0
        for corner in range(3):
            i = faces[f, corner]
            p, q = frames.hats[f, corner, 0], frames.hats[f, corner, 1]
            x, y, z = shape[i, 0], shape[i, 1], shape[i, 2]
            ux, uy, uz = ux + x * p, uy + y * p, uz + z * p
            vx, vy, vz = vx + x * q, vy + y * q, vz + z * q
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        size = np.sqrt(np.sqrt(nx * nx + ny * ny + nz * nz))
        if size > 0.0:
            nx, ny, nz = nx / size, ny / size, nz / size
        T = frames.tangents[f]
        across = (
            T[1, 0] * T[2, 1] - T[2, 0] * T[1, 1],
            T[2, 0] * T[0, 1] - T[0, 0] * T[2, 1],
            T[0, 0] * T[1, 1] - T[1, 0] * T[0, 1],
        )
        for c in range(3):
            full[f, 0, c] = ux * T[c, 0] + vx * T[c, 1] + nx * across[c]
            full[f, 1, c] = uy * T[c, 0] + vy * T[c, 1] + ny * across[c]
            full[f, 2, c] = uz * T[c, 0] + vz * T[c, 1] + nz * across[c]
            for a in range(3):
                mean[a, c] += frames.areas[f] * full[f, a, c]
        _stretch(ux * ux + uy * uy + uz * uz, ux * vx + uy * vy + uz * vz,
                 vx * vx + vy * vy + vz * vz, S[f])  # fmt: skip
    return full, mean, S


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
