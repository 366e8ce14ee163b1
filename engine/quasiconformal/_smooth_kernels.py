"""Loops over triangles and hinges for Newton steps on the Beltrami coefficient.

A hinge is a pair of triangles with a common edge, given by the two half-edges along it: number
3 t + k runs from corner k of triangle t to the next. ``a`` (m, 3) are the weights of f_z and, as
conjugates, of f_z̄; ∂μ/∂wᵢ = (āᵢ - μ aᵢ) / f_z (``slopes``), complex-linear in corner i.
"""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import BoolArray, ComplexArray, FloatArray, IntArray

LEAST = 1e-14  # of 1 - |μ|², below which a triangle counts as flat


@kernel
def hinge_corners(faces: IntArray, first: IntArray, second: IntArray) -> IntArray:
    """The vertices (e, 4) of each hinge: its edge, then the corners across; -1 if there is none."""
    corners = np.full((len(first), 4), -1, np.int64)
    for e in range(len(first)):
        t, k = first[e] // 3, first[e] % 3
        for i in range(3):
            corners[e, i] = faces[t, (k + i) % 3]
        if second[e] >= 0:
            corners[e, 3] = faces[second[e] // 3, (second[e] % 3 + 2) % 3]
    return corners


@kernel
def coefficient_and_slopes(
    a: ComplexArray, faces: IntArray, w: ComplexArray, slopes: ComplexArray, inverse: ComplexArray
) -> ComplexArray:
    """μ (m,) of ``w``; fills ``slopes`` (m, 3) and ``inverse`` (m,), 1 / f_z. No f_z may be 0."""
    mu = np.zeros(len(faces), np.complex128)
    for t in range(len(faces)):
        p = 0j
        q = 0j
        for i in range(3):
            p += a[t, i] * w[faces[t, i]]
            q += a[t, i].conjugate() * w[faces[t, i]]
        mu[t] = q / p
        inverse[t] = 1.0 / p
        for i in range(3):
            slopes[t, i] = (a[t, i].conjugate() - mu[t] * a[t, i]) * inverse[t]
    return mu


@kernel
def face_slopes(
    mu: ComplexArray,
    face: FloatArray,
    still: FloatArray,
    pull: FloatArray,
    power: float,
    delta: float,
    level: float,
) -> tuple[FloatArray, FloatArray]:
    """First and second derivatives (m,), by s = |μ|², of the face terms of ``total_energy``."""
    first = np.empty(len(mu))
    second = np.empty(len(mu))
    for t in range(len(mu)):
        square = mu[t].real ** 2 + mu[t].imag ** 2
        left = max(1.0 - square, LEAST)
        m = (1.0 + square) / left
        root = np.sqrt(square + delta * delta)
        outer = power * m ** (power - 1.0) * face[t] if face[t] > 0.0 else 0.0
        once, twice = 2.0 / left**2, 4.0 / left**3
        first[t] = outer * once + 0.5 * still[t] / root
        first[t] += 0.5 * pull[t] * (square - level) / level
        second[t] = outer * (twice + (power - 1.0) / m * once * once)
        second[t] += 0.5 * pull[t] / level - 0.25 * still[t] / root**3
    return first, second


@kernel
def total_energy(
    a: ComplexArray,
    faces: IntArray,
    w: ComplexArray,
    first: IntArray,
    second: IntArray,
    hinge_weight: FloatArray,
    face: FloatArray,
    still: FloatArray,
    pull: FloatArray,
    power: float,
    delta: float,
    level: float,
) -> float:
    """Σ_e w_e |μᵢ - μⱼ|² + Σ_t (face m^power + still √(s + δ²) + pull (s - level)² / (4 level)).

    s = |μ|², m = (1 + s) / (1 - s). Faces with ``face`` 0 cannot move and are left out of the
    second sum; infinite where |μ| ≥ 1 on another.
    """
    mu = np.empty(len(faces), np.complex128)
    energy = 0.0
    for t in range(len(faces)):
        p = 0j
        q = 0j
        for i in range(3):
            p += a[t, i] * w[faces[t, i]]
            q += a[t, i].conjugate() * w[faces[t, i]]
        mu[t] = q / p
        if face[t] <= 0.0:
            continue
        square = (q.real**2 + q.imag**2) / (p.real**2 + p.imag**2)
        if not 1.0 - square >= LEAST:
            return np.inf
        energy += face[t] * ((1.0 + square) / (1.0 - square)) ** power
        energy += still[t] * np.sqrt(square + delta * delta)
        energy += 0.25 * pull[t] * (square - level) ** 2 / level
    for e in range(len(first)):
        if second[e] >= 0:
            jump = mu[first[e] // 3] - mu[second[e] // 3]
            energy += hinge_weight[e] * (jump.real**2 + jump.imag**2)
    return energy


@kernel
def forces(
    mu: ComplexArray,
    first: IntArray,
    second: IntArray,
    hinge_weight: FloatArray,
    face_slope: FloatArray,
) -> ComplexArray:
    """G (m,) with dE = Σ_t Re(conj(G_t) dμ_t) for the energy E of ``total_energy``."""
    force = 2.0 * face_slope * mu
    for e in range(len(first)):
        if second[e] >= 0:
            t, u = first[e] // 3, second[e] // 3
            jump = 2.0 * hinge_weight[e] * (mu[t] - mu[u])
            force[t] += jump
            force[u] -= jump
    return force


@kernel
def pulled_back(faces: IntArray, slopes: ComplexArray, force: ComplexArray, n: int) -> ComplexArray:
    """The gradient (n,) over vertices, as complex numbers, of an energy with ``force`` over μ."""
    gradient = np.zeros(n, np.complex128)
    for t in range(len(faces)):
        for i in range(3):
            gradient[faces[t, i]] += slopes[t, i].conjugate() * force[t]
    return gradient


@kernel
def hessian_product(
    a: ComplexArray,
    faces: IntArray,
    mu: ComplexArray,
    slopes: ComplexArray,
    inverse: ComplexArray,
    force: ComplexArray,
    first: IntArray,
    second: IntArray,
    hinge_weight: FloatArray,
    face_slope: FloatArray,
    face_curve: FloatArray,
    d: ComplexArray,
) -> ComplexArray:
    """The exact Hessian of ``total_energy`` times a displacement ``d`` (n,) of the vertices.

    μ is holomorphic, d²μ = -2 dμ df_z / f_z; so the second-order term is one more pass.
    """
    m = len(faces)
    moved = np.empty(m, np.complex128)
    scaled = np.empty(m, np.complex128)
    pull = np.empty(m, np.complex128)
    for t in range(m):
        dp = 0j
        dmu = 0j
        for i in range(3):
            dp += a[t, i] * d[faces[t, i]]
            dmu += slopes[t, i] * d[faces[t, i]]
        moved[t] = dmu
        scaled[t] = dp * inverse[t]
        along = mu[t].real * dmu.real + mu[t].imag * dmu.imag
        pull[t] = 2.0 * face_slope[t] * dmu + 4.0 * face_curve[t] * along * mu[t]
    for e in range(len(first)):
        if second[e] >= 0:
            t, u = first[e] // 3, second[e] // 3
            jump = 2.0 * hinge_weight[e] * (moved[t] - moved[u])
            pull[t] += jump
            pull[u] -= jump
    product = np.zeros(len(d), np.complex128)
    for t in range(m):
        over_slopes = pull[t] - force[t] * scaled[t].conjugate()
        over_weights = force[t] * (inverse[t] * moved[t]).conjugate()
        for i in range(3):
            product[faces[t, i]] += (
                slopes[t, i].conjugate() * over_slopes - a[t, i].conjugate() * over_weights
            )
    return product


@kernel
def assemble_preconditioner(
    slopes: ComplexArray,
    first: IntArray,
    second: IntArray,
    hinge_weight: FloatArray,
    face_stiffness: FloatArray,
    hinges_of: IntArray,
    position: IntArray,
    data: FloatArray,
) -> None:
    """The real part of the matrix of Σ 2 w_e |dμᵢ - dμⱼ|² + Σ ``face_stiffness`` |dμ|².

    In ``data``, one row per vertex. ``position`` (e, 4, 4) is where a hinge's entries go; what a
    triangle adds is shared out among its ``hinges_of`` (m,) hinges.
    """
    data[:] = 0.0
    near = np.zeros(4, np.complex128)
    far = np.zeros(4, np.complex128)
    for e in range(len(first)):
        t, k = first[e] // 3, first[e] % 3
        near_weight = face_stiffness[t] / hinges_of[t]
        far_weight = 0.0
        for i in range(3):
            near[i] = slopes[t, (k + i) % 3]
        if second[e] >= 0:
            u, j = second[e] // 3, second[e] % 3
            far_weight = face_stiffness[u] / hinges_of[u]
            far[0], far[1] = slopes[u, (j + 1) % 3], slopes[u, j]
            far[3] = slopes[u, (j + 2) % 3]
        twice = 2.0 * hinge_weight[e]
        for i in range(4):
            across = twice * (near[i] - far[i])
            here = near_weight * near[i]
            there = far_weight * far[i]
            for j in range(4):
                at = position[e, i, j]
                if at >= 0:
                    difference = near[j] - far[j]
                    data[at] += across.real * difference.real + across.imag * difference.imag
                    data[at] += here.real * near[j].real + here.imag * near[j].imag
                    data[at] += there.real * far[j].real + there.imag * far[j].imag


@kernel
def entries_touching(fixed: BoolArray, indptr: IntArray, indices: IntArray) -> BoolArray:
    """Which stored entries (nnz,) of a lower CSC pattern lie in a row or column that is fixed."""
    touching = np.zeros(len(indices), np.bool_)
    for column in range(len(indptr) - 1):
        for at in range(indptr[column], indptr[column + 1]):
            touching[at] = fixed[column] or fixed[indices[at]]
    return touching
