"""Loops over triangles for the untangling energy of Garanzha et al. (2021) in the plane.

Σ_t W_t ((P + Q) / χ(D))^k with P = |f_z|², Q = |f_z̄|², D = P - Q the area ratio and
χ(D) = (D + √(D² + ε²)) / 2, which is D itself once ε = 0.
"""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import ComplexArray, FloatArray, IntArray


@kernel
def _softened(ratio: float, epsilon: float) -> tuple[float, float, float]:
    """χ(D) and its first two derivatives, without cancellation for D < 0."""
    if epsilon <= 0.0:
        return ratio, 1.0, 0.0
    root = np.sqrt(ratio * ratio + epsilon * epsilon)
    if ratio > 0.0:
        chi = 0.5 * (ratio + root)
    else:
        chi = 0.5 * epsilon * epsilon / (root - ratio)
    return chi, chi / root, 0.5 * epsilon * epsilon / root**3


@kernel
def untangling_energy(
    a: ComplexArray,
    faces: IntArray,
    w: ComplexArray,
    weight: FloatArray,
    epsilon: float,
    power: float,
) -> float:
    """The energy above; infinite when ε = 0 and a triangle is turned."""
    energy = 0.0
    for t in range(len(faces)):
        p = 0j
        q = 0j
        for i in range(3):
            p += a[t, i] * w[faces[t, i]]
            q += a[t, i].conjugate() * w[faces[t, i]]
        P = p.real**2 + p.imag**2
        Q = q.real**2 + q.imag**2
        if epsilon <= 0.0 and P <= Q:
            return np.inf
        chi = _softened(P - Q, epsilon)[0]
        energy += weight[t] * ((P + Q) / chi) ** power
    return energy


@kernel
def mips_block(
    a: ComplexArray,
    p: complex,
    q: complex,
    weight: float,
    epsilon: float,
    power: float,
    rows: FloatArray,
    block: FloatArray,
    pull: FloatArray,
) -> None:
    """One triangle's projected Hessian in ``block`` (6, 6) and gradient in ``pull`` (6,).

    In the frame of the arguments of f_z and f_z̄ the Hessian of a function of (P, Q) splits into
    two scalars and one 2x2 block; their eigenvalues are cut at 0. ``rows`` (4, 6): work space.
    """
    P = p.real**2 + p.imag**2
    Q = q.real**2 + q.imag**2
    X, X1, X2 = _softened(P - Q, epsilon)
    N = P + Q
    m = N / X
    m_p = 1.0 / X - N * X1 / X**2
    m_q = 1.0 / X + N * X1 / X**2
    bend = N * (2.0 * X1 * X1 / X**3 - X2 / X**2)
    outer = weight * power * m ** (power - 1.0)
    curve = weight * power * (power - 1.0) * m ** (power - 2.0)
    h_p = outer * m_p
    h_q = outer * m_q
    h_pp = outer * (bend - 2.0 * X1 / X**2) + curve * m_p * m_p
    h_qq = outer * (bend + 2.0 * X1 / X**2) + curve * m_q * m_q
    h_pq = -outer * bend + curve * m_p * m_q
    abs_p = np.sqrt(P)
    abs_q = np.sqrt(Q)
    along_p = p / abs_p if abs_p > 0.0 else 1.0 + 0j
    along_q = q / abs_q if abs_q > 0.0 else 1.0 + 0j
    turn_p = max(2.0 * h_p, 0.0)
    turn_q = max(2.0 * h_q, 0.0)
    a11 = 2.0 * h_p + 4.0 * h_pp * P
    a22 = 2.0 * h_q + 4.0 * h_qq * Q
    a12 = 4.0 * h_pq * abs_p * abs_q
    middle = 0.5 * (a11 + a22)
    half = 0.5 * (a11 - a22)
    radius = np.sqrt(half * half + a12 * a12)
    top = max(middle + radius, 0.0)
    bottom = max(middle - radius, 0.0)
    mean = 0.5 * (top + bottom)
    spread = 0.5 * (top - bottom) / radius if radius > 0.0 else 0.0
    b11 = mean + spread * half
    b22 = mean - spread * half
    b12 = spread * a12
    for i in range(3):
        c = along_p.conjugate() * a[i]
        d = along_q.conjugate() * a[i].conjugate()
        rows[0, 2 * i] = c.real
        rows[0, 2 * i + 1] = -c.imag
        rows[1, 2 * i] = c.imag
        rows[1, 2 * i + 1] = c.real
        rows[2, 2 * i] = d.real
        rows[2, 2 * i + 1] = -d.imag
        rows[3, 2 * i] = d.imag
        rows[3, 2 * i + 1] = d.real
    for i in range(6):
        pull[i] = 2.0 * (h_p * abs_p * rows[0, i] + h_q * abs_q * rows[2, i])
        for j in range(6):
            block[i, j] = (
                rows[0, i] * (b11 * rows[0, j] + b12 * rows[2, j])
                + rows[2, i] * (b12 * rows[0, j] + b22 * rows[2, j])
                + turn_p * rows[1, i] * rows[1, j]
                + turn_q * rows[3, i] * rows[3, j]
            )


@kernel
def assemble_untangling(
    a: ComplexArray,
    faces: IntArray,
    w: ComplexArray,
    weight: FloatArray,
    epsilon: float,
    power: float,
    position: IntArray,
    data: FloatArray,
    gradient: FloatArray,
) -> None:
    """The projected Hessian in ``data`` at ``position`` (m, 6, 6) and the gradient (n, 2)."""
    data[:] = 0.0
    gradient[:] = 0.0
    rows = np.zeros((4, 6))
    block = np.zeros((6, 6))
    pull = np.zeros(6)
    for t in range(len(faces)):
        p = 0j
        q = 0j
        for i in range(3):
            p += a[t, i] * w[faces[t, i]]
            q += a[t, i].conjugate() * w[faces[t, i]]
        mips_block(a[t], p, q, float(weight[t]), epsilon, power, rows, block, pull)
        for i in range(6):
            gradient[faces[t, i // 2], i % 2] += pull[i]
            for j in range(6):
                if position[t, i, j] >= 0:
                    data[position[t, i, j]] += block[i, j]
