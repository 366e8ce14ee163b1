"""Per-face loops over the shapes that faces have on the surface, as coefficients of f_z.

On a face f_z = Σ a_i w_i and f_z̄ = Σ conj(a_i) w_i for corner positions w.
"""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import ComplexArray, FloatArray, IntArray


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
