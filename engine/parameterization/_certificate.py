"""Whether positions in the plane are a bijection onto the disk, decided without rounding."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from engine.parameterization._mips_kernels import signed_areas
from engine.types import ComplexArray, IntArray


def folded_faces(z: ComplexArray, faces: IntArray) -> IntArray:
    """Faces (k,) whose signed area is not positive; exact (rationals decide what doubles can't)."""
    area, bound = signed_areas(z, faces)
    doubtful = np.flatnonzero(np.abs(area) <= bound)
    folded = area < -bound
    for face in doubtful:
        (ax, ay), (bx, by), (cx, cy) = (
            (Fraction(float(w.real)), Fraction(float(w.imag))) for w in z[faces[face]]
        )
        folded[face] = (ax - cx) * (by - cy) <= (ay - cy) * (bx - cx)
    return np.flatnonzero(folded)


def rim_turns_once(circle: ComplexArray) -> bool:
    """Whether boundary positions (b,) lie on the unit circle in order, strictly, once around."""
    if np.abs(np.abs(circle) - 1).max() > 1e-12:
        return False
    steps = np.angle(np.roll(circle, -1) / circle)
    return bool((steps > 0).all()) and abs(float(steps.sum()) - 2 * np.pi) < 1e-6
