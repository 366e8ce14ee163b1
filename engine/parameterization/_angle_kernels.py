"""Per-corner loops of the angle distortion Σ |angle in the plane - angle on the surface|."""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import ComplexArray, FloatArray, IntArray


@kernel
def angle_changes(a: ComplexArray, faces: IntArray, w: ComplexArray) -> FloatArray:
    """Change (m, 3), in radians, of the angle at each corner from the shapes behind the
    coefficients ``a`` (m, 3) to the plane w; no face of w may fold."""
    change = np.empty((len(faces), 3))
    for t in range(len(faces)):
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            at = w[faces[t, i]]
            turn = (w[faces[t, k]] - at) / (w[faces[t, j]] - at)
            change[t, i] = np.angle(-turn * a[t, j] / a[t, k])
    return change


@kernel
def angle_system(
    a: ComplexArray,
    faces: IntArray,
    w: ComplexArray,
    frame: ComplexArray,
    softening: float,
    dofs: IntArray,
    position: IntArray,
    nnz: int,
    unknowns: int,
) -> tuple[FloatArray, FloatArray]:
    """Lower data (nnz,) of the Gauss-Newton matrix and the gradient of the reweighted distortion.

    A corner's change d counts d² / (d² + ``softening``²)^½, its weight held. Vertex v moves along
    ``frame`` v and i ``frame`` v: ``dofs`` (m, 6) are the two unknowns of each corner,
    ``position`` (m, 6, 6) their places in the data.
    """
    data = np.zeros(nnz)
    gradient = np.zeros(unknowns)
    changes = angle_changes(a, faces, w)
    partial = np.empty(3, np.complex128)
    r = np.empty(6)
    for t in range(len(faces)):
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            forth = 1 / (w[faces[t, j]] - w[faces[t, i]])
            back = 1 / (w[faces[t, k]] - w[faces[t, i]])
            partial[i] = (forth - back) * frame[faces[t, i]]
            partial[j] = -forth * frame[faces[t, j]]
            partial[k] = back * frame[faces[t, k]]
            for x in range(3):
                r[2 * x], r[2 * x + 1] = partial[x].imag, partial[x].real
            d = changes[t, i]
            weight = 1 / np.sqrt(d * d + softening * softening)
            for x in range(6):
                if dofs[t, x] < 0:
                    continue
                gradient[dofs[t, x]] += weight * d * r[x]
                for y in range(6):
                    if position[t, x, y] >= 0:
                        data[position[t, x, y]] += weight * r[x] * r[y]
    return data, gradient
