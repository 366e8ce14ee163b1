"""Per-face loops of the conformal distortion energy and its regularised form.

On a face f_z = Σ a_i w_i and f_z̄ = Σ conj(a_i) w_i for corner positions w. With P = |f_z|²,
Q = |f_z̄|², D = P - Q the energy is m = (P + Q + λ (1 + D²)) / χ, χ = (D + √(D² + ε²)) / 2
(Garanzha et al. 2021). ε = λ = 0 gives MIPS (Hormann & Greiner 2000), which is infinite on folds;
λ keeps faces from escaping a positive ε by shrinking to points.
"""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import BoolArray, ComplexArray, FloatArray, IntArray


@kernel
def face_coefficients(vertices: FloatArray, faces: IntArray, least_height: float) -> ComplexArray:
    """a (m, 3) of each face laid flat; slivers get a height of ``least_height`` longest edges."""
    a = np.empty((len(faces), 3), np.complex128)
    corner = np.empty(3, np.complex128)
    for t in range(len(faces)):
        longest, k = -1.0, 0
        for i in range(3):
            square = 0.0
            for x in range(3):
                edge = vertices[faces[t, (i + 1) % 3], x] - vertices[faces[t, i], x]
                square += edge * edge
            if square > longest:
                longest, k = square, i
        base = np.sqrt(longest) if longest > 0.0 else 1.0
        along, square = 0.0, 0.0
        for x in range(3):
            edge = vertices[faces[t, (k + 1) % 3], x] - vertices[faces[t, k], x]
            side = vertices[faces[t, (k + 2) % 3], x] - vertices[faces[t, k], x]
            along += edge * side / base
            square += side * side
        height = max(np.sqrt(max(square - along * along, 0.0)), least_height * base)
        corner[k], corner[(k + 1) % 3], corner[(k + 2) % 3] = 0.0, base, along + 1j * height
        for i in range(3):
            edge = corner[(i + 2) % 3] - corner[(i + 1) % 3]
            a[t, i] = -0.5j * edge.conjugate() / (base * height)
    return a


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
def _regular(D: float, epsilon: float) -> float:
    root = np.sqrt(D * D + epsilon * epsilon)
    return 0.5 * (D + root) if D > 0.0 else 0.5 * epsilon * epsilon / (root - D)


@kernel
def determinants(a: ComplexArray, faces: IntArray, w: ComplexArray) -> FloatArray:
    """D (m,), the factor by which each face's signed area grows."""
    D = np.empty(len(faces))
    for t in range(len(faces)):
        p, q = _derivatives(a, faces, w, t)
        D[t] = p.real**2 + p.imag**2 - q.real**2 - q.imag**2
    return D


@kernel
def dilatations(a: ComplexArray, faces: IntArray, w: ComplexArray) -> FloatArray:
    """|f_z̄ / f_z| (m,)."""
    size = np.empty(len(faces))
    for t in range(len(faces)):
        p, q = _derivatives(a, faces, w, t)
        size[t] = abs(q) / max(abs(p), 1e-300)
    return size


@kernel
def energy(
    a: ComplexArray,
    weights: FloatArray,
    faces: IntArray,
    w: ComplexArray,
    epsilon: float,
    area: float,
) -> float:
    """Σ weights m with λ = ``area``; infinite where ε = 0 and a face folds."""
    total = 0.0
    for t in range(len(faces)):
        p, q = _derivatives(a, faces, w, t)
        P, Q = p.real**2 + p.imag**2, q.real**2 + q.imag**2
        D = P - Q
        if epsilon <= 0.0 and D <= 0.0:
            return np.inf
        chi = D if epsilon <= 0.0 else _regular(D, epsilon)
        total += weights[t] * (P + Q + area * (1.0 + D * D)) / chi
    return total


@kernel
def newton_system(
    a: ComplexArray,
    weights: FloatArray,
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
        D = P - Q
        N = P + Q + area * (1.0 + D * D)
        n_p, n_q = 1.0 + 2.0 * area * D, 1.0 - 2.0 * area * D
        chi, slope, curve = D, 1.0, 0.0
        if epsilon > 0.0:
            root = np.sqrt(D * D + epsilon * epsilon)
            chi = _regular(D, epsilon)
            slope, curve = chi / root, 0.5 * epsilon * epsilon / root**3
        bend = N * (2 * slope * slope / chi**3 - curve / chi**2)
        first, second = slope / chi**2, 2.0 * area / chi + bend
        mp, mq = n_p / chi - N * first, n_q / chi + N * first
        sp, sq = np.sqrt(P), np.sqrt(Q)
        u = p / sp if sp > 0.0 else 1 + 0j
        v = q / sq if sq > 0.0 else 1 + 0j
        h_pp = 2 * mp + 4 * (second - 2 * n_p * first) * P
        h_qq = 2 * mq + 4 * (second + 2 * n_q * first) * Q
        h_pq = 4 * ((n_p - n_q) * first - second) * sp * sq
        middle, half = 0.5 * (h_pp + h_qq), 0.5 * (h_pp - h_qq)
        radius = np.sqrt(half * half + h_pq * h_pq)
        if middle - radius < 0.0:
            top = max(middle + radius, 0.0)
            scale = 0.5 * top / radius if radius > 0.0 else 0.0
            h_pp, h_qq, h_pq = scale * (radius + half), scale * (radius - half), scale * h_pq
        across_p, across_q = max(2 * mp, 0.0), max(2 * mq, 0.0)
        for i in range(3):
            turn = frame[faces[t, i]]
            c = u.conjugate() * a[t, i] * turn
            d = v.conjugate() * a[t, i].conjugate() * turn
            r[0, 2 * i], r[0, 2 * i + 1] = c.real, -c.imag
            r[1, 2 * i], r[1, 2 * i + 1] = c.imag, c.real
            r[2, 2 * i], r[2, 2 * i + 1] = d.real, -d.imag
            r[3, 2 * i], r[3, 2 * i + 1] = d.imag, d.real
        W = weights[t]
        for j in range(6):
            T[0, j] = W * (h_pp * r[0, j] + h_pq * r[2, j])
            T[1, j] = W * across_p * r[1, j]
            T[2, j] = W * (h_pq * r[0, j] + h_qq * r[2, j])
            T[3, j] = W * across_q * r[3, j]
        for i in range(6):
            if dofs[t, i] < 0:
                continue
            gradient[dofs[t, i]] += W * (2 * mp * sp * r[0, i] + 2 * mq * sq * r[2, i])
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
def image_scale(faces: IntArray, a: ComplexArray, w: ComplexArray, n: int) -> FloatArray:
    """The local scale (m,) of w at each face, folded or not: perimeters of image to face."""
    total = np.zeros(n)
    count = np.zeros(n)
    for t in range(len(faces)):
        image, own = 0.0, 0.0
        for i in range(3):
            image += abs(w[faces[t, i]] - w[faces[t, (i + 1) % 3]])
            own += abs(a[t, i])
        own *= 0.5 / abs((a[t, 0].conjugate() * a[t, 1]).imag)
        for i in range(3):
            total[faces[t, i]] += image / own
            count[faces[t, i]] += 1.0
    scale = np.zeros(len(faces))
    for t in range(len(faces)):
        for i in range(3):
            scale[t] += total[faces[t, i]] / count[faces[t, i]] / 3
    return scale


@kernel
def grow(inside: BoolArray, faces: IntArray, rings: int) -> BoolArray:
    """The vertices (n,) within ``rings`` faces of those ``inside``."""
    inside = inside.copy()
    for _ in range(rings):
        before = inside.copy()
        for t in range(len(faces)):
            if before[faces[t, 0]] or before[faces[t, 1]] or before[faces[t, 2]]:
                for i in range(3):
                    inside[faces[t, i]] = True
    return inside


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
