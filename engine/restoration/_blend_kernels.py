"""Compiled loops over faces: blended gradients, and how they lie once joined."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from engine._jit import kernel
from engine.restoration._frames import Frames
from engine.types import FloatArray, IntArray


@kernel
def _exponential(w: FloatArray, R: FloatArray) -> None:
    angle = np.sqrt(w[0] ** 2 + w[1] ** 2 + w[2] ** 2)
    if angle < 1e-8:
        s, c = 1.0, 0.5
    else:
        s, c = np.sin(angle) / angle, (1.0 - np.cos(angle)) / (angle * angle)
    x, y, z = w[0], w[1], w[2]
    R[0, 0] = 1.0 - c * (y * y + z * z)
    R[0, 1] = c * x * y - s * z
    R[0, 2] = c * x * z + s * y
    R[1, 0] = c * x * y + s * z
    R[1, 1] = 1.0 - c * (x * x + z * z)
    R[1, 2] = c * y * z - s * x
    R[2, 0] = c * x * z - s * y
    R[2, 1] = c * y * z + s * x
    R[2, 2] = 1.0 - c * (x * x + y * y)


@kernel
def _lifted(value: float, floor: float) -> float:
    """``value`` above ``floor``, below it a positive number, once differentiable."""
    return value if value >= floor else floor * np.exp(value / floor - 1.0)


@kernel
def _guard(S: FloatArray, floor: float) -> None:
    """Keep the symmetric 2 x 2 stretch ``S`` (uu, uv, vv) positive definite, in place."""
    mean = 0.5 * (S[0] + S[2])
    half = 0.5 * (S[0] - S[2])
    radius = np.sqrt(half * half + S[1] * S[1])
    if mean - radius >= floor:
        return
    low = _lifted(mean - radius, floor)
    high = _lifted(mean + radius, floor)
    factor = 0.5 * (high - low) / radius if radius > 0.0 else 0.0
    S[0] = 0.5 * (high + low) + factor * half
    S[2] = 0.5 * (high + low) - factor * half
    S[1] = factor * S[1]


class Parts(NamedTuple):
    """The shapes' deformation gradients on the faces, taken apart."""

    whole: FloatArray  # (k, 3) rotation vectors of the shapes' rigid motions
    omega: FloatArray  # (k, m, 3) rotation vectors relative to those
    stretch: FloatArray  # (k, m, 3) S_uu, S_uv, S_vv
    floors: FloatArray  # (m,) the least principal stretch that is left alone


@kernel
def face_means(faces: IntArray, values: FloatArray) -> FloatArray:
    """The mean (k, m) over each face's corners of ``values`` (k, n)."""
    out = np.empty((len(values), len(faces)))
    for j in range(len(values)):
        for f in range(len(faces)):
            a, b, c = values[j, faces[f, 0]], values[j, faces[f, 1]], values[j, faces[f, 2]]
            out[j, f] = (a + b + c) / 3.0
    return out


@kernel
def blended_stretches(parts: Parts, weights: FloatArray) -> FloatArray:
    """Stretches (m, 3) S_uu, S_uv, S_vv of the faces at ``weights`` (k, m)."""
    stretch = parts.stretch
    S = np.empty(stretch.shape[1:])
    for f in range(len(S)):
        S[f, 0], S[f, 1], S[f, 2] = 1.0, 0.0, 1.0
        for j in range(len(weights)):
            a = weights[j, f]
            S[f, 0] += a * (stretch[j, f, 0] - 1.0)
            S[f, 1] += a * stretch[j, f, 1]
            S[f, 2] += a * (stretch[j, f, 2] - 1.0)
        _guard(S[f], parts.floors[f])
    return S


@kernel
def damped_weights(
    asked: FloatArray, below: FloatArray, above: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The weights (k, m) that faces take of those ``asked`` (k, m), and what they leave (m,).

    ``below`` and ``above`` (k, m): the rates that damp what lies below 0 and above 1.
    """
    given = asked.copy()
    left = np.zeros(asked.shape[1])
    for j in range(len(asked)):
        for f in range(asked.shape[1]):
            a = asked[j, f]
            if a < 0.0 and below[j, f] > 0.0:
                given[j, f] = np.expm1(below[j, f] * a) / below[j, f]
            elif a > 1.0 and above[j, f] > 0.0:
                given[j, f] = 1.0 - np.expm1(above[j, f] * (1.0 - a)) / above[j, f]
            left[f] += abs(a - given[j, f])
    return given, left


@kernel
def deformations(faces: IntArray, frames: Frames, x: FloatArray) -> FloatArray:
    """Deformation gradients (m, 3, 2) of the faces of ``x`` (n, 3)."""
    out = np.zeros((len(faces), 3, 2))
    for f in range(len(faces)):
        for corner in range(3):
            v = faces[f, corner]
            for c in range(3):
                for d in range(2):
                    out[f, c, d] += x[v, c] * frames.hats[f, corner, d]
    return out


@kernel
def blended_gradients(
    frames: Frames, parts: Parts, stretch: FloatArray, weights: FloatArray, common: FloatArray
) -> FloatArray:
    """Deformation gradients (m, 3, 2): ``stretch`` turned by rotations at ``weights`` (k, m).

    ``common`` (k, m): the weights of the shapes' rigid rotations.
    """
    tangents, whole, omega = frames.tangents, parts.whole, parts.omega
    out = np.empty((len(stretch), 3, 2))
    w = np.empty(3)
    g = np.empty(3)
    R = np.empty((3, 3))
    G = np.empty((3, 3))
    flat = np.empty(3)
    turned = np.empty(3)
    for f in range(len(stretch)):
        w[:] = 0.0
        g[:] = 0.0
        for j in range(len(weights)):
            a = weights[j, f]
            b = common[j, f]
            if a == 0.0 and b == 0.0:
                continue
            for c in range(3):
                w[c] += a * omega[j, f, c]
                g[c] += b * whole[j, c]
        _exponential(w, R)
        _exponential(g, G)
        for d in range(2):
            for c in range(3):
                flat[c] = tangents[f, c, 0] * stretch[f, d] + tangents[f, c, 1] * stretch[f, d + 1]
            for c in range(3):
                turned[c] = R[c, 0] * flat[0] + R[c, 1] * flat[1] + R[c, 2] * flat[2]
            for c in range(3):
                out[f, c, d] = G[c, 0] * turned[0] + G[c, 1] * turned[1] + G[c, 2] * turned[2]
    return out


@kernel
def _isometry(J: FloatArray, Q: FloatArray) -> None:
    """The isometry ``Q`` (3, 2) nearest to ``J``.

    Where ``J`` has rank one to rounding, only where it takes what it keeps is sure, and exact: so
    the area comes from the normal, not from the lengths, whose products cancel.
    """
    n0 = J[1, 0] * J[2, 1] - J[2, 0] * J[1, 1]
    n1 = J[2, 0] * J[0, 1] - J[0, 0] * J[2, 1]
    n2 = J[0, 0] * J[1, 1] - J[1, 0] * J[0, 1]
    area = np.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
    if area > 0.0:
        n0, n1, n2 = n0 / area, n1 / area, n2 / area
    square = 2.0 * area
    for c in range(3):
        square += J[c, 0] * J[c, 0] + J[c, 1] * J[c, 1]
    scale = 1.0 / np.sqrt(square) if square > 0.0 else 0.0
    Q[0, 0] = scale * (J[0, 0] + J[1, 1] * n2 - J[2, 1] * n1)
    Q[1, 0] = scale * (J[1, 0] + J[2, 1] * n0 - J[0, 1] * n2)
    Q[2, 0] = scale * (J[2, 0] + J[0, 1] * n1 - J[1, 1] * n0)
    Q[0, 1] = scale * (J[0, 1] + n1 * J[2, 0] - n2 * J[1, 0])
    Q[1, 1] = scale * (J[1, 1] + n2 * J[0, 0] - n0 * J[2, 0])
    Q[2, 1] = scale * (J[2, 1] + n0 * J[1, 0] - n1 * J[0, 0])


@kernel
def returned_gradients(
    faces: IntArray,
    frames: Frames,
    stretch: FloatArray,
    x: FloatArray,
    blended: FloatArray,
    extra: FloatArray,
    far: float,
) -> FloatArray:
    """Deformation gradients (m, 3, 2): ``stretch`` (m, 3) turned as the faces of ``x`` (n, 3) lie.

    ``extra`` (m, 3, 2) is what ``x`` has on top. Faces that lie otherwise than ``blended``
    (m, 3, 2) by more than the share ``far`` of their size turn ever less: no face flips over.
    """
    hats = frames.hats
    out = np.empty(blended.shape)
    J = np.empty((3, 2))
    Q = np.empty((3, 2))
    for f in range(len(faces)):
        S = stretch[f]
        off = 0.0
        for c in range(3):
            for d in range(2):
                J[c, d] = -blended[f, c, d] - extra[f, c, d]
                for corner in range(3):
                    J[c, d] += x[faces[f, corner], c] * hats[f, corner, d]
                off += J[c, d] * J[c, d]
        size = S[0] * S[0] + 2.0 * S[1] * S[1] + S[2] * S[2]
        trust = 1.0 / (1.0 + off / (far * far * size)) ** 2
        for c in range(3):
            p = blended[f, c, 0] + trust * J[c, 0]
            q = blended[f, c, 1] + trust * J[c, 1]
            J[c, 0] = p * S[0] + q * S[1]
            J[c, 1] = p * S[1] + q * S[2]
        _isometry(J, Q)
        for c in range(3):
            out[f, c, 0] = Q[c, 0] * S[0] + Q[c, 1] * S[1]
            out[f, c, 1] = Q[c, 0] * S[1] + Q[c, 1] * S[2]
    return out


@kernel
def divergence(
    faces: IntArray, frames: Frames, gradients: FloatArray, vertex_count: int
) -> FloatArray:
    """Divergence (n, 3) of deformation ``gradients`` (m, 3, 2): the Poisson equation's right."""
    hats, areas = frames.hats, frames.areas
    out = np.zeros((vertex_count, 3))
    for f in range(len(faces)):
        for corner in range(3):
            v = faces[f, corner]
            p = areas[f] * hats[f, corner, 0]
            q = areas[f] * hats[f, corner, 1]
            for c in range(3):
                out[v, c] += p * gradients[f, c, 0] + q * gradients[f, c, 1]
    return out


@kernel
def transition_gradients(
    faces: IntArray, frames: Frames, moves: FloatArray, weights: FloatArray
) -> FloatArray:
    """The faces' ``moves`` (k, n, 3) times the slope of ``weights`` (k, n): (m, 3, 2)."""
    hats = frames.hats
    out = np.zeros((len(faces), 3, 2))
    for f in range(len(faces)):
        for j in range(len(weights)):
            p = 0.0
            q = 0.0
            for corner in range(3):
                v = faces[f, corner]
                p += weights[j, v] * hats[f, corner, 0]
                q += weights[j, v] * hats[f, corner, 1]
            if p == 0.0 and q == 0.0:
                continue
            for c in range(3):
                mean = 0.0
                for corner in range(3):
                    mean += moves[j, faces[f, corner], c] / 3.0
                out[f, c, 0] += p * mean
                out[f, c, 1] += q * mean
    return out
