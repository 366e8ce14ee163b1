"""Per-face loops of the conformal distortion energy and its regularised form.

On a face f_z = Σ a_i w_i and f_z̄ = Σ conj(a_i) w_i for corner positions w. With P = |f_z|²,
Q = |f_z̄|², D = P - Q the energy is (P + Q + λ (1 + D²)) / χ, χ = (D + √(D² + ε²)) / 2 (Garanzha
et al., Foldover-free maps in 50 lines of code, 2021). ε = λ = 0 gives MIPS (Hormann & Greiner
2000), which is infinite on folds; λ keeps faces from escaping a positive ε by shrinking to points.
"""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import ComplexArray, FloatArray, IntArray


@kernel
def _derivatives(
    a: ComplexArray, faces: IntArray, w: ComplexArray, t: int
) -> tuple[complex, complex]:
    p = q = 0j
    for i in range(3):
        p += a[t, i] * w[faces[t, i]]
        q += a[t, i].conjugate() * w[faces[t, i]]
    return p, q


@kernel
def _regular(D: float, epsilon: float) -> tuple[float, float, float]:
    """χ(D) and its first two derivatives, without cancellation for D < 0."""
    if epsilon <= 0.0:
        return D, 1.0, 0.0
    root = np.sqrt(D * D + epsilon * epsilon)
    chi = 0.5 * (D + root) if D > 0.0 else 0.5 * epsilon * epsilon / (root - D)
    return chi, chi / root, 0.5 * epsilon * epsilon / root**3


@kernel
def area_ratios(a: ComplexArray, faces: IntArray, w: ComplexArray) -> FloatArray:
    """D (m,): signed area of each face's image over its own, |f_z|² - |f_z̄|²."""
    ratio = np.empty(len(faces))
    for t in range(len(faces)):
        p, q = _derivatives(a, faces, w, t)
        ratio[t] = p.real**2 + p.imag**2 - q.real**2 - q.imag**2
    return ratio


@kernel
def dilatations(a: ComplexArray, faces: IntArray, w: ComplexArray) -> FloatArray:
    """|f_z̄ / f_z| (m,); 10 where f_z vanishes."""
    size = np.empty(len(faces))
    for t in range(len(faces)):
        p, q = _derivatives(a, faces, w, t)
        size[t] = min(abs(q) / abs(p), 10.0) if p != 0j else 10.0
    return size


@kernel
def energy(a: ComplexArray, faces: IntArray, w: ComplexArray, epsilon: float, area: float) -> float:
    """The sum over the faces with λ = ``area``; infinite where ε = 0 and a face folds."""
    total = 0.0
    for t in range(len(faces)):
        p, q = _derivatives(a, faces, w, t)
        P, Q = p.real**2 + p.imag**2, q.real**2 + q.imag**2
        D = P - Q
        if epsilon <= 0.0 and not D > 0.0:
            return np.inf
        total += (P + Q + area * (1.0 + D * D)) / _regular(D, epsilon)[0]
    return total


@kernel
def _derivatives_of_energy(
    P: float, Q: float, epsilon: float, area: float
) -> tuple[float, float, float, float, float]:
    """First and second derivatives m_P, m_Q, m_PP, m_QQ, m_PQ of a face's energy by P and Q."""
    D = P - Q
    N = P + Q + area * (1.0 + D * D)
    n_p, n_q = 1.0 + 2.0 * area * D, 1.0 - 2.0 * area * D
    chi, slope, curve = _regular(D, epsilon)
    first = slope / chi**2
    second = 2.0 * area / chi + N * (2.0 * slope * slope / chi**3 - curve / chi**2)
    return (
        n_p / chi - N * first,
        n_q / chi + N * first,
        second - 2.0 * n_p * first,
        second + 2.0 * n_q * first,
        (n_p - n_q) * first - second,
    )


@kernel
def _projected(h_pp: float, h_qq: float, h_pq: float) -> tuple[float, float, float]:
    """The symmetric 2 x 2 matrix with its negative eigenvalues cut at 0."""
    middle, half = 0.5 * (h_pp + h_qq), 0.5 * (h_pp - h_qq)
    radius = np.sqrt(half * half + h_pq * h_pq)
    if middle - radius >= 0.0:
        return h_pp, h_qq, h_pq
    top = max(middle + radius, 0.0)
    scale = 0.5 * top / radius if radius > 0.0 else 0.0
    return scale * (radius + half), scale * (radius - half), scale * h_pq


@kernel
def _directions(
    a: ComplexArray,
    faces: IntArray,
    frame: ComplexArray,
    t: int,
    along_p: complex,
    along_q: complex,
    rows: FloatArray,
) -> None:
    """``rows`` (4, 6): how f_z and f_z̄ move, along themselves and across, with each coordinate."""
    for i in range(3):
        turn = frame[faces[t, i]]
        c = along_p.conjugate() * a[t, i] * turn
        d = along_q.conjugate() * a[t, i].conjugate() * turn
        rows[0, 2 * i], rows[0, 2 * i + 1] = c.real, -c.imag
        rows[1, 2 * i], rows[1, 2 * i + 1] = c.imag, c.real
        rows[2, 2 * i], rows[2, 2 * i + 1] = d.real, -d.imag
        rows[3, 2 * i], rows[3, 2 * i + 1] = d.imag, d.real


@kernel
def newton_system(
    a: ComplexArray,
    faces: IntArray,
    w: ComplexArray,
    frame: ComplexArray,
    epsilon: float,
    area: float,
    dofs: IntArray,
    position: IntArray,
    nnz: int,
    unknowns: int,
) -> tuple[FloatArray, FloatArray]:
    """Lower data (nnz,) of the projected Hessian (positive semi-definite), and the gradient.

    λ = ``area``. Vertex v moves along ``frame`` v and i ``frame`` v: ``dofs`` (m, 6) are the two
    unknowns of each corner, ``position`` (m, 6, 6) their places in the data. The projection is
    analytic: in the directions of f_z and f_z̄ and across them the Hessian is a 2 x 2 block and
    two scalars.
    """
    data = np.zeros(nnz)
    gradient = np.zeros(unknowns)
    r = np.empty((4, 6))
    T = np.empty((4, 6))
    for t in range(len(faces)):
        p, q = _derivatives(a, faces, w, t)
        P, Q = p.real**2 + p.imag**2, q.real**2 + q.imag**2
        mp, mq, mpp, mqq, mpq = _derivatives_of_energy(P, Q, epsilon, area)
        sp, sq = np.sqrt(P), np.sqrt(Q)
        h_pp, h_qq, h_pq = _projected(2 * mp + 4 * mpp * P, 2 * mq + 4 * mqq * Q, 4 * mpq * sp * sq)
        across_p, across_q = max(2 * mp, 0.0), max(2 * mq, 0.0)
        u = p / sp if sp > 0.0 else 1 + 0j
        v = q / sq if sq > 0.0 else 1 + 0j
        _directions(a, faces, frame, t, u, v, r)
        for j in range(6):
            T[0, j] = h_pp * r[0, j] + h_pq * r[2, j]
            T[1, j] = across_p * r[1, j]
            T[2, j] = h_pq * r[0, j] + h_qq * r[2, j]
            T[3, j] = across_q * r[3, j]
        for i in range(6):
            if dofs[t, i] < 0:
                continue
            gradient[dofs[t, i]] += 2 * (mp * sp * r[0, i] + mq * sq * r[2, i])
            for j in range(6):
                at = position[t, i, j]
                if at >= 0:
                    data[at] += r[0, i] * T[0, j] + r[1, i] * T[1, j]
                    data[at] += r[2, i] * T[2, j] + r[3, i] * T[3, j]
    return data, gradient


@kernel
def first_fold(a: ComplexArray, faces: IntArray, w: ComplexArray, step: ComplexArray) -> float:
    """The smallest s > 0 at which a face of w + s ``step`` loses its area; all have some now."""
    smallest = np.inf
    for t in range(len(faces)):
        p, q = _derivatives(a, faces, w, t)
        dp, dq = _derivatives(a, faces, step, t)
        C = p.real**2 + p.imag**2 - q.real**2 - q.imag**2
        A = dp.real**2 + dp.imag**2 - dq.real**2 - dq.imag**2
        B = 2 * ((p.conjugate() * dp).real - (q.conjugate() * dq).real)
        inside = B * B - 4 * A * C
        if inside < 0.0:
            continue
        root = np.sqrt(inside)
        if B <= 0.0:
            s = 2 * C / (root - B) if root > B else np.inf
        else:
            s = -(B + root) / (2 * A) if A < 0.0 else np.inf
        if 0.0 < s < smallest:
            smallest = s
    return smallest


@kernel
def keep_order(rim: IntArray, w: ComplexArray, step: ComplexArray) -> None:
    """Shorten, in place, angular steps that take over 0.45 of the gap to a neighbour on the rim.

    ``rim`` (k, 2) are boundary edges, ``w`` (n,) on the unit circle at their ends.
    """
    for e in range(len(rim)):
        i, j = rim[e]
        gap = np.angle(w[j] / w[i])
        most = 0.45 * (gap if gap > 0.0 else gap + 2 * np.pi)
        forward = (step[i] / w[i]).imag
        if forward > most:
            step[i] *= most / forward
        backward = -(step[j] / w[j]).imag
        if backward > most:
            step[j] *= most / backward
