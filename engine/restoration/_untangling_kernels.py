"""Compiled loops of untangling: the barrier of every face, and its sums over unknowns in space."""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import FloatArray, IntArray

_OPEN = 1e-3  # the regularisation of areas that are positive
_BEHIND = 0.2  # and of those that are not, in their own size


@kernel
def _gradient(x: FloatArray, face: IntArray, hats: FloatArray, J: FloatArray) -> None:
    """Deformation gradient of one face as ``J`` (6,): the images of its two tangents."""
    J[:] = 0.0
    for k in range(3):
        for c in range(2):
            for a in range(3):
                J[3 * c + a] += x[face[k], a] * hats[k, c]


@kernel
def _signed_area(J: FloatArray, up: FloatArray) -> float:
    """Area ratio of one face as seen along ``up`` (3,)."""
    return (
        up[0] * (J[1] * J[5] - J[2] * J[4])
        + up[1] * (J[2] * J[3] - J[0] * J[5])
        + up[2] * (J[0] * J[4] - J[1] * J[3])
    )


@kernel
def _opened(area: float, regular: float) -> tuple[float, float]:
    """A positive number that tends to ``area`` > 0 with ``regular``, and its derivative."""
    root = np.sqrt(regular * regular + area * area)
    value = 0.5 * (area + root) if area > 0.0 else 0.5 * regular * regular / (root - area)
    return value, value / root


@kernel
def _distortion(J: FloatArray, area: float, opened: float) -> float:
    square = 0.0
    for i in range(6):
        square += J[i] * J[i]
    return (0.5 * square + 0.5 * (1.0 + area * area)) / opened


@kernel
def signed_areas(x: FloatArray, faces: IntArray, hats: FloatArray, up: FloatArray) -> FloatArray:
    """Area ratios (m,) of ``faces`` as seen along ``up`` (m, 3): negative where turned over."""
    J = np.empty(6)
    out = np.empty(len(faces))
    for f in range(len(faces)):
        _gradient(x, faces[f], hats[f], J)
        out[f] = _signed_area(J, up[f])
    return out


@kernel
def regularisation(areas: FloatArray) -> FloatArray:
    """How far (m,) signed area ratios may be opened: little, but for faces turned over."""
    out = np.empty(len(areas))
    for f in range(len(areas)):
        out[f] = np.sqrt(_OPEN**2 + (_BEHIND * min(areas[f], 0.0)) ** 2)
    return out


@kernel
def _state(
    x: FloatArray,
    face: IntArray,
    hats: FloatArray,
    up: FloatArray,
    regular: float,
    J: FloatArray,
) -> tuple[float, float, float, float]:
    """Signed area of a face, the same opened, its slope, and the distortion; J (6,) is filled."""
    _gradient(x, face, hats, J)
    area = _signed_area(J, up)
    opened, slope = _opened(area, regular)
    return area, opened, slope, _distortion(J, area, opened)


@kernel
def barrier(
    x: FloatArray,
    faces: IntArray,
    hats: FloatArray,
    up: FloatArray,
    weight: FloatArray,
    regular: FloatArray,
    bearable: float,
) -> float:
    """Sum of ``weight`` (m,) times s^2/(s + b), s the distortion of a face above ``bearable`` b.

    The distortion is (|J|^2 + 1 + D^2) / (2 D) with D the signed area, opened by ``regular``.
    """
    J = np.empty(6)
    total = 0.0
    for f in range(len(faces)):
        _, _, _, psi = _state(x, faces[f], hats[f], up[f], regular[f], J)
        over = psi - bearable
        if over > 0.0:
            total += weight[f] * over * over / (over + bearable)
    return total


@kernel
def barrier_model(
    x: FloatArray,
    faces: IntArray,
    hats: FloatArray,
    up: FloatArray,
    weight: FloatArray,
    regular: FloatArray,
    bearable: float,
) -> tuple[FloatArray, FloatArray]:
    """Gradient (n, 3) of ``barrier`` and convex second-order blocks (m, 9, 9) per face.

    What makes the blocks indefinite, the curvature of D and of its opening, is left out (Garanzha
    et al., "Foldover-free maps in 50 lines of code", 2021).
    """
    gradient = np.zeros((len(x), 3))
    blocks = np.zeros((len(faces), 9, 9))
    J, dA, g, h = np.empty(6), np.empty(6), np.empty(6), np.empty((6, 6))
    for f in range(len(faces)):
        area, chi, slope, psi = _state(x, faces[f], hats[f], up[f], regular[f], J)
        over = psi - bearable
        if over <= 0.0:
            continue
        u = up[f]
        dA[0], dA[1], dA[2] = (
            J[4] * u[2] - J[5] * u[1],
            J[5] * u[0] - J[3] * u[2],
            J[3] * u[1] - J[4] * u[0],
        )
        dA[3], dA[4], dA[5] = (
            u[1] * J[2] - u[2] * J[1],
            u[2] * J[0] - u[0] * J[2],
            u[0] * J[1] - u[1] * J[0],
        )
        by_area = (area - psi * slope) / chi
        second = (1.0 - 2.0 * by_area * slope) / chi
        first = weight[f] * (over * over + 2.0 * over * bearable) / (over + bearable) ** 2
        bend = weight[f] * 2.0 * bearable**2 / (over + bearable) ** 3
        for i in range(6):
            g[i] = J[i] / chi + by_area * dA[i]
        for i in range(6):
            for j in range(6):
                mixed = (J[i] * dA[j] + dA[i] * J[j]) * slope / (chi * chi)
                h[i, j] = first * (second * dA[i] * dA[j] - mixed) + bend * g[i] * g[j]
            h[i, i] += first / chi
        for k in range(3):
            for a in range(3):
                for c in range(2):
                    gradient[faces[f, k], a] += first * g[3 * c + a] * hats[f, k, c]
                for m in range(3):
                    for b in range(3):
                        for c in range(2):
                            for d in range(2):
                                blocks[f, 3 * k + a, 3 * m + b] += (
                                    hats[f, k, c] * h[3 * c + a, 3 * d + b] * hats[f, m, d]
                                )
    return gradient, blocks


@kernel
def spatial_pattern(indptr: IntArray, indices: IntArray) -> tuple[IntArray, IntArray]:
    """Lower CSC pattern of three unknowns (3i, 3i+1, 3i+2) for each one of a lower CSC pattern."""
    n = len(indptr) - 1
    pointer = np.zeros(3 * n + 1, np.int64)
    rows = np.empty(9 * len(indices) - 3 * n, np.int64)
    at = 0
    for j in range(n):
        for c in range(3):
            for e in range(indptr[j], indptr[j + 1]):
                for a in range(3):
                    if indices[e] > j or a >= c:
                        rows[at] = 3 * indices[e] + a
                        at += 1
            pointer[3 * j + c + 1] = at
    return pointer, rows


@kernel
def entries_of(indptr: IntArray, indices: IntArray, faces: IntArray) -> IntArray:
    """Which stored entry (m, 3, 3) of a lower CSC pattern holds each pair of corners.

    -1 above the diagonal and for corners -1.
    """
    out = np.full((len(faces), 3, 3), -1, np.int64)
    for f in range(len(faces)):
        for k in range(3):
            for m in range(3):
                i, j = faces[f, k], faces[f, m]
                if i >= j >= 0:
                    column = indices[indptr[j] : indptr[j + 1]]
                    out[f, k, m] = indptr[j] + np.searchsorted(column, i)
    return out


@kernel
def spatial_data(
    indptr: IntArray,
    stiffness: FloatArray,
    faces: IntArray,
    entries: IntArray,
    blocks: FloatArray,
) -> FloatArray:
    """Values on ``spatial_pattern``: ``stiffness`` (nnz,) alike on each axis, plus ``blocks``."""
    n = len(indptr) - 1
    data = np.zeros(9 * len(stiffness) - 3 * n)
    start = np.empty(n, np.int64)
    for j in range(n):
        start[j] = 9 * indptr[j] - 3 * j
        width = 3 * (indptr[j + 1] - indptr[j])
        for c in range(3):
            column = start[j] + c * width - c * (c - 1) // 2
            for k in range(indptr[j + 1] - indptr[j]):
                data[column + 3 * k] += stiffness[indptr[j] + k]
    for f in range(len(faces)):
        for k in range(3):
            for m in range(3):
                if entries[f, k, m] < 0:
                    continue
                j = faces[f, m]
                width = 3 * (indptr[j + 1] - indptr[j])
                row = 3 * (entries[f, k, m] - indptr[j])
                for c in range(3):
                    column = start[j] + c * width - c * (c - 1) // 2 - c
                    for a in range(3):
                        if row > 0 or a >= c:
                            data[column + row + a] += blocks[f, 3 * k + a, 3 * m + c]
    return data
