"""Compiled loops over faces: which way is up after an edit, and who shows the other side."""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.restoration._rotation_kernels import nearest_rotation
from engine.types import BoolArray, FloatArray, IntArray

_SURELY = 1e-9  # of cosines: more than rounding


@kernel
def turned_normals(faces: IntArray, covariance: FloatArray, normal: FloatArray) -> FloatArray:
    """The ``normal`` (m, 3) of each face turned as its corners' ``covariance`` (n, 9) says."""
    out = np.empty_like(normal)
    S = np.empty((3, 3))
    R = np.empty((3, 3))
    N = np.empty((4, 4))
    q = np.empty(4)
    for f in range(len(faces)):
        _face_covariance(faces[f], covariance, S)
        nearest_rotation(S, R, N, q)
        for a in range(3):
            out[f, a] = R[a, 0] * normal[f, 0] + R[a, 1] * normal[f, 1] + R[a, 2] * normal[f, 2]
    return out


@kernel
def inverted(
    faces: IntArray, covariance: FloatArray, normal: FloatArray, after: FloatArray
) -> BoolArray:
    """Which faces (m,) show along ``after`` (m, 3) the side that ``turned_normals`` is not on.

    Most are told without a rotation: ``S`` = R P turns a normal n as R does, but for the angle
    between n and P n, whose sine is at most (k - 1) / (k + 1) where P has the condition k.
    """
    out = np.empty(len(faces), np.bool_)
    S = np.empty((3, 3))
    R = np.empty((3, 3))
    N = np.empty((4, 4))
    q = np.empty(4)
    for f in range(len(faces)):
        _face_covariance(faces[f], covariance, S)
        n, m = normal[f], after[f]
        if _surely_upright(S, n, m):
            out[f] = False
            continue
        nearest_rotation(S, R, N, q)
        shown = 0.0
        for a in range(3):
            shown += m[a] * (R[a, 0] * n[0] + R[a, 1] * n[1] + R[a, 2] * n[2])
        out[f] = shown < 0.0
    return out


@kernel
def _face_covariance(face: IntArray, covariance: FloatArray, S: FloatArray) -> None:
    i, j, k = face[0], face[1], face[2]
    for a in range(3):
        for b in range(3):
            c = 3 * a + b
            S[a, b] = covariance[i, c] + covariance[j, c] + covariance[k, c]


@kernel
def _surely_upright(S: FloatArray, n: FloatArray, m: FloatArray) -> bool:
    """Whether the rotation next to ``S`` (3, 3) surely turns ``n`` (3,) to the side of ``m``.

    The condition is at most |S|^3 / (2 det S), for the smallest singular value is det S over the
    product of the others, which is at most |S|^2 / 2.
    """
    det = (
        S[0, 0] * (S[1, 1] * S[2, 2] - S[1, 2] * S[2, 1])
        - S[0, 1] * (S[1, 0] * S[2, 2] - S[1, 2] * S[2, 0])
        + S[0, 2] * (S[1, 0] * S[2, 1] - S[1, 1] * S[2, 0])
    )
    if det <= 0.0:
        return False
    square = dot = to = own = 0.0
    for a in range(3):
        turned = S[a, 0] * n[0] + S[a, 1] * n[1] + S[a, 2] * n[2]
        square += S[a, 0] ** 2 + S[a, 1] ** 2 + S[a, 2] ** 2
        dot += m[a] * turned
        to += turned * turned
        own += m[a] * m[a]
    condition = 0.5 * square * np.sqrt(square) / det
    sine = (condition - 1.0) / (condition + 1.0) + _SURELY
    return dot > sine * np.sqrt(to * own)
