"""Loops over triangles and hinges for the Gauss-Newton steps on the Beltrami coefficient.

A hinge is a pair of triangles with a common edge. ``a`` (m, 3) are the weights of f_z and, as
conjugates, of f_z̄; ∂μ/∂wᵢ = (āᵢ - μ aᵢ) / f_z, complex-linear in the displacement of corner i.
"""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.quasiconformal._mips_kernels import mips_block
from engine.types import BoolArray, ComplexArray, FloatArray, IntArray


@kernel
def coefficient_and_slopes(
    a: ComplexArray, faces: IntArray, w: ComplexArray, slopes: ComplexArray
) -> ComplexArray:
    """μ (m,) of ``w``; fills ``slopes`` (m, 3) with ∂μ/∂wᵢ. Every f_z must differ from 0."""
    mu = np.zeros(len(faces), np.complex128)
    for t in range(len(faces)):
        p = 0j
        q = 0j
        for i in range(3):
            p += a[t, i] * w[faces[t, i]]
            q += a[t, i].conjugate() * w[faces[t, i]]
        mu[t] = q / p
        for i in range(3):
            slopes[t, i] = (a[t, i].conjugate() - mu[t] * a[t, i]) / p
    return mu


@kernel
def smoothness(
    mu: ComplexArray, pairs: IntArray, pair_weight: FloatArray, face_weight: FloatArray
) -> float:
    """Σ_e w_e |μᵢ - μⱼ|² + Σ_t W_t (1 + |μ|²) / (1 - |μ|²); infinite where |μ| ≥ 1."""
    energy = 0.0
    for e in range(len(pairs)):
        jump = mu[pairs[e, 0]] - mu[pairs[e, 1]]
        energy += pair_weight[e] * (jump.real**2 + jump.imag**2)
    for t in range(len(mu)):
        square = mu[t].real ** 2 + mu[t].imag ** 2
        if square >= 1.0:
            return np.inf
        energy += face_weight[t] * (1.0 + square) / (1.0 - square)
    return energy


@kernel
def assemble_hinges(
    a: ComplexArray,
    faces: IntArray,
    w: ComplexArray,
    mu: ComplexArray,
    slopes: ComplexArray,
    pairs: IntArray,
    corners: IntArray,
    local: IntArray,
    carries: BoolArray,
    pair_weight: FloatArray,
    face_weight: FloatArray,
    shift: ComplexArray,
    position: IntArray,
    data: FloatArray,
    gradient: FloatArray,
) -> None:
    """Gauss-Newton matrix of ``smoothness`` in ``data``, gradient (n, 2) plus matrix times shift.

    ``corners`` (e, 4) are a hinge's vertices, ``local`` (e, 2, 3) says which of the four each
    corner of its triangles is, ``carries`` (e, 2) whether it adds that triangle's barrier;
    ``position`` (e, 8, 8) is where the entries go, ``shift`` (n,) a displacement of vertices.
    """
    data[:] = 0.0
    gradient[:] = 0.0
    row = np.zeros(4, np.complex128)
    block = np.zeros((8, 8))
    rows = np.zeros((4, 6))
    small = np.zeros((6, 6))
    force = np.zeros(6)
    pull = np.zeros(8)
    move = np.zeros(8)
    for e in range(len(pairs)):
        row[:] = 0j
        block[:] = 0.0
        for i in range(3):
            row[local[e, 0, i]] += slopes[pairs[e, 0], i]
            row[local[e, 1, i]] -= slopes[pairs[e, 1], i]
        jump = mu[pairs[e, 0]] - mu[pairs[e, 1]]
        twice = 2.0 * pair_weight[e]
        for i in range(4):
            along = twice * jump.conjugate() * row[i]
            pull[2 * i] = along.real
            pull[2 * i + 1] = -along.imag
            move[2 * i] = shift[corners[e, i]].real
            move[2 * i + 1] = shift[corners[e, i]].imag
            for j in range(4):
                h = twice * row[i].conjugate() * row[j]
                block[2 * i, 2 * j] = h.real
                block[2 * i, 2 * j + 1] = -h.imag
                block[2 * i + 1, 2 * j] = h.imag
                block[2 * i + 1, 2 * j + 1] = h.real
        for side in range(2):
            if carries[e, side]:
                t = pairs[e, side]
                p = 0j
                q = 0j
                for i in range(3):
                    p += a[t, i] * w[faces[t, i]]
                    q += a[t, i].conjugate() * w[faces[t, i]]
                mips_block(a[t], p, q, float(face_weight[t]), 0.0, 1.0, rows, small, force)
                for i in range(6):
                    k = 2 * local[e, side, i // 2] + i % 2
                    pull[k] += force[i]
                    for j in range(6):
                        block[k, 2 * local[e, side, j // 2] + j % 2] += small[i, j]
        for i in range(8):
            for j in range(8):
                pull[i] += block[i, j] * move[j]
                if position[e, i, j] >= 0:
                    data[position[e, i, j]] += block[i, j]
            gradient[corners[e, i // 2], i % 2] += pull[i]


@kernel
def first_fold(a: ComplexArray, faces: IntArray, w: ComplexArray, d: ComplexArray) -> float:
    """The largest s such that w + s' d keeps every triangle's orientation for 0 ≤ s' < s."""
    limit = np.inf
    for t in range(len(faces)):
        p = 0j
        q = 0j
        dp = 0j
        dq = 0j
        for i in range(3):
            p += a[t, i] * w[faces[t, i]]
            q += a[t, i].conjugate() * w[faces[t, i]]
            dp += a[t, i] * d[faces[t, i]]
            dq += a[t, i].conjugate() * d[faces[t, i]]
        constant = abs(p) ** 2 - abs(q) ** 2
        linear = 2.0 * ((p.conjugate() * dp).real - (q.conjugate() * dq).real)
        square = abs(dp) ** 2 - abs(dq) ** 2
        under = linear * linear - 4.0 * square * constant
        if under < 0.0:
            continue
        root = np.sqrt(under)
        if linear <= 0.0 and root > linear:
            limit = min(limit, 2.0 * constant / (root - linear))
        elif linear > 0.0 and square < 0.0:
            limit = min(limit, -(linear + root) / (2.0 * square))
    return limit


@kernel
def area_ratios(a: ComplexArray, faces: IntArray, w: ComplexArray) -> FloatArray:
    """Signed area of each triangle over its area in the domain, |f_z|² - |f_z̄|²."""
    ratio = np.zeros(len(faces))
    for t in range(len(faces)):
        p = 0j
        q = 0j
        for i in range(3):
            p += a[t, i] * w[faces[t, i]]
            q += a[t, i].conjugate() * w[faces[t, i]]
        ratio[t] = p.real**2 + p.imag**2 - q.real**2 - q.imag**2
    return ratio
