"""Compiled loops over faces: polar parts, logarithms, unwrapping, and blended gradients."""

from __future__ import annotations

from typing import NamedTuple

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
def blended_gradients(
    frames: Frames, parts: Parts, stretch: FloatArray, weights: FloatArray
) -> FloatArray:
    """Deformation gradients (m, 3, 2): ``stretch`` turned by rotations at ``weights`` (k, m)."""
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
            if a == 0.0:
                continue
            for c in range(3):
                w[c] += a * omega[j, f, c]
                g[c] += a * whole[j, c]
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
        aa = 0.0
        ab = 0.0
        bb = 0.0
        for c in range(3):
            p = blended[f, c, 0] + trust * J[c, 0]
            q = blended[f, c, 1] + trust * J[c, 1]
            J[c, 0] = p * S[0] + q * S[1]
            J[c, 1] = p * S[1] + q * S[2]
            aa += J[c, 0] * J[c, 0]
            ab += J[c, 0] * J[c, 1]
            bb += J[c, 1] * J[c, 1]
        s = np.sqrt(max(aa * bb - ab * ab, 0.0))
        det = (aa + s) * (bb + s) - ab * ab
        scale = np.sqrt(aa + bb + 2.0 * s) / det if det > 0.0 else 0.0
        for c in range(3):
            p = scale * (J[c, 0] * (bb + s) - J[c, 1] * ab)
            q = scale * (J[c, 1] * (aa + s) - J[c, 0] * ab)
            out[f, c, 0] = p * S[0] + q * S[1]
            out[f, c, 1] = p * S[1] + q * S[2]
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
