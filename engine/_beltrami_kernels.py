"""Per-triangle loops behind ``engine.beltrami``."""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import ComplexArray, FloatArray, IntArray

# Shewchuk (1997), the bound A of the planar orientation test, with u = 2^-53
ORIENTATION_BOUND = 3.3306690738754716e-16


@kernel
def flat_corners(vertices: FloatArray, faces: IntArray) -> ComplexArray:
    """(m, 3): each triangle in its own plane, first corner at 0, first edge on the real axis."""
    corners = np.zeros((len(faces), 3), np.complex128)
    for t in range(len(faces)):
        a = vertices[faces[t, 0]]
        b = vertices[faces[t, 1]]
        c = vertices[faces[t, 2]]
        length = np.sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2 + (b[2] - a[2]) ** 2)
        if length == 0.0:
            corners[t, 2] = np.sqrt((c[0] - a[0]) ** 2 + (c[1] - a[1]) ** 2 + (c[2] - a[2]) ** 2)
            continue
        along = 0.0
        for k in range(3):
            along += (c[k] - a[k]) * (b[k] - a[k]) / length
        across = 0.0
        for k in range(3):
            across += (c[k] - a[k] - along * (b[k] - a[k]) / length) ** 2
        corners[t, 1] = length
        corners[t, 2] = complex(along, np.sqrt(across))
    return corners


@kernel
def wirtinger_weights(corners: ComplexArray) -> tuple[ComplexArray, FloatArray]:
    """a (m, 3) with f_z = sum_i a_i w_i and f_zbar = sum_i conj(a_i) w_i; signed areas (m,)."""
    a = np.zeros(corners.shape, np.complex128)
    area = np.zeros(len(corners))
    for t in range(len(corners)):
        u = corners[t, 1] - corners[t, 0]
        v = corners[t, 2] - corners[t, 0]
        area[t] = 0.5 * (u.real * v.imag - u.imag * v.real)
        if area[t] == 0.0:
            continue
        for i in range(3):
            edge = corners[t, (i + 2) % 3] - corners[t, (i + 1) % 3]
            a[t, i] = complex(-edge.imag, -edge.real) / (4.0 * area[t])
    return a, area


@kernel
def coefficients(corners: ComplexArray, faces: IntArray, image: ComplexArray) -> ComplexArray:
    """f_zbar / f_z per triangle, from edges alone: no division by the triangle's area."""
    mu = np.zeros(len(faces), np.complex128)
    for t in range(len(faces)):
        p = 0j
        q = 0j
        origin = image[faces[t, 0]]
        for i in range(1, 3):
            edge = corners[t, (i + 2) % 3] - corners[t, (i + 1) % 3]
            w = image[faces[t, i]] - origin
            p += edge.conjugate() * w
            q -= edge * w
        if p == 0j:
            mu[t] = complex(np.inf, 0.0)
        else:
            mu[t] = q / p
    return mu


@kernel
def filtered_orientations(corners: ComplexArray) -> IntArray:
    """1 counter-clockwise, -1 clockwise, 0 not decided by double precision, per triangle."""
    sign = np.zeros(len(corners), np.int64)
    for t in range(len(corners)):
        u = corners[t, 1] - corners[t, 0]
        v = corners[t, 2] - corners[t, 0]
        left = u.real * v.imag
        right = u.imag * v.real
        bound = ORIENTATION_BOUND * (abs(left) + abs(right))
        if left - right > bound:
            sign[t] = 1
        elif left - right < -bound:
            sign[t] = -1
    return sign


@kernel
def assemble_beltrami(
    a: ComplexArray,
    area: FloatArray,
    faces: IntArray,
    mu: ComplexArray,
    unknown: IntArray,
    image: ComplexArray,
    position: IntArray,
    data: FloatArray,
    load: ComplexArray,
) -> None:
    """div(A grad u) = 0, A = [[α₁, α₂], [α₂, α₃]](μ), as matrix ``data`` and right side ``load``.

    ``unknown`` (n,) numbers the free vertices, -1 where ``image`` (n,) is given; ``position``
    (m, 3, 3) is where the entries of a triangle go.
    """
    data[:] = 0.0
    load[:] = 0.0
    for t in range(len(faces)):
        rho = mu[t].real
        tau = mu[t].imag
        below = area[t] / (1.0 - rho * rho - tau * tau)
        alpha1 = ((rho - 1.0) ** 2 + tau * tau) * below
        alpha2 = -2.0 * tau * below
        alpha3 = ((1.0 + rho) ** 2 + tau * tau) * below
        for i in range(3):
            row = unknown[faces[t, i]]
            if row < 0:
                continue
            x = 2.0 * a[t, i].real
            y = -2.0 * a[t, i].imag
            flux_x = 2.0 * (alpha1 * x + alpha2 * y)
            flux_y = 2.0 * (alpha2 * x + alpha3 * y)
            for j in range(3):
                entry = flux_x * a[t, j].real - flux_y * a[t, j].imag
                if position[t, i, j] >= 0:
                    data[position[t, i, j]] += entry
                elif unknown[faces[t, j]] < 0:
                    load[row] -= entry * image[faces[t, j]]
