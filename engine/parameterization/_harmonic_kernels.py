"""Per-face loops of a weighted Laplacian that is never stored whole, and of barycentric areas.

``weights`` (m, 3) sit at corners; each adds to the edge opposite: xᵀLx = Σ w_ij (x_i - x_j)².
"""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.linalg import Values
from engine.types import ComplexArray, FloatArray, IntArray


@kernel
def laplacian_data(weights: FloatArray, position: IntArray, nnz: int) -> FloatArray:
    """Lower data (nnz,) of L; ``position`` (m, 3, 3) are the places of each face's entries."""
    data = np.zeros(nnz)
    for t in range(len(weights)):
        for k in range(3):
            i, j = (k + 1) % 3, (k + 2) % 3
            w = weights[t, k]
            if position[t, i, i] >= 0:
                data[position[t, i, i]] += w
            if position[t, j, j] >= 0:
                data[position[t, j, j]] += w
            if position[t, i, j] >= 0:
                data[position[t, i, j]] -= w
            if position[t, j, i] >= 0:
                data[position[t, j, i]] -= w
    return data


@kernel
def laplacian_product(faces: IntArray, weights: FloatArray, x: Values) -> Values:
    """L x (n,), for real or complex x."""
    y = np.zeros_like(x)
    for t in range(len(faces)):
        for k in range(3):
            a, b = faces[t, (k + 1) % 3], faces[t, (k + 2) % 3]
            flow = weights[t, k] * (x[a] - x[b])
            y[a] += flow
            y[b] -= flow
    return y


@kernel
def barycentric_areas(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """A third (n,) of the area of every face at a vertex of ``vertices`` (n, 3)."""
    area = np.zeros(len(vertices))
    for t in range(len(faces)):
        a, b, c = faces[t]
        square = 0.0
        for x in range(3):
            y = (x + 1) % 3
            u, p = vertices[b, x] - vertices[a, x], vertices[b, y] - vertices[a, y]
            v, q = vertices[c, x] - vertices[a, x], vertices[c, y] - vertices[a, y]
            square += (u * q - p * v) ** 2
        third = np.sqrt(square) / 6
        area[a] += third
        area[b] += third
        area[c] += third
    return area


@kernel
def central_bump(z: ComplexArray, faces: IntArray, power: float) -> FloatArray:
    """Plane areas (n,) at vertices times (1 - |z|²) to ``power``, 1 at its greatest."""
    height = np.zeros(len(z))
    top = 0.0
    for v in range(len(z)):
        height[v] = max(1.0 - z[v].real ** 2 - z[v].imag ** 2, 1e-16)
        top = max(top, height[v])
    bump = np.zeros(len(z))
    for t in range(len(faces)):
        a, b, c = faces[t]
        area = abs(((z[b] - z[a]).conjugate() * (z[c] - z[a])).imag)
        bump[a] += area
        bump[b] += area
        bump[c] += area
    for v in range(len(z)):
        bump[v] *= (height[v] / top) ** power
    return bump
