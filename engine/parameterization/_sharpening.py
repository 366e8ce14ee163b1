"""Descent of the mean angle distortion within bijections; the rim slides, other boundaries move."""

from __future__ import annotations

import numpy as np

from engine._distortion_kernels import keep_order
from engine.distortion import slid
from engine.linalg import ElementPattern, SymmetricPattern
from engine.parameterization._angle_kernels import angle_changes, angle_system
from engine.parameterization._certificate import folded_vertices
from engine.parameterization._triangulation_kernels import grow
from engine.types import BoolArray, ComplexArray, IntArray

_SOFTENING = np.radians(0.1)
_DAMPING = 1e-5  # of the diagonal: a turn of the whole disk changes no angle
_ATTEMPTS = 40


class AngleDescent:
    """Gauss-Newton steps on Σ |angle in the plane - angle on the surface| over all corners.

    The absolute values are reweighted squares (Weiszfeld 1937). ``a`` (m, 3) are coefficients of
    the ``faces`` (m, 3); the ends of the ``rim`` edges (k, 2) slide along the unit circle without
    passing each other. ``holes`` are loops of vertices that must stay simple and clockwise. A face
    with all corners on the rim plays no part: along an arc it cannot have the shape that it has
    on the surface.
    """

    def __init__(
        self,
        a: ComplexArray,
        faces: IntArray,
        rim: IntArray,
        n: int,
        holes: tuple[IntArray, ...] = (),
    ) -> None:
        self._on_rim: BoolArray = np.zeros(n, dtype=np.bool_)
        self._on_rim[rim] = True
        shaped = ~self._on_rim[faces].all(axis=1)
        self._every, self._rim, self._holes = faces, rim, holes
        self._a, self._faces = a[shaped], faces[shaped]
        used = np.zeros(n, dtype=np.bool_)
        used[self._faces] = True
        self._free = np.stack([used & ~self._on_rim, used], axis=1)
        dofs = np.where(self._free.ravel(), np.cumsum(self._free) - 1, -1).reshape(n, 2)
        count = int(self._free.sum())
        pattern = ElementPattern(dofs[self._faces].reshape(-1, 6), count)
        self._pattern = pattern
        self._analysis = SymmetricPattern(pattern.indptr, pattern.indices, once=True)

    def distortion(self, w: ComplexArray) -> float:
        """The sum of all changes of angle, in radians."""
        return float(np.abs(angle_changes(self._a, self._faces, w)).sum())

    def step(self, w: ComplexArray) -> ComplexArray:
        """``w`` (n,) after one step; around faces and holes that it would fold, vertices stay."""
        if not self._pattern.n:
            return w
        frame = np.where(self._on_rim, w, 1.0 + 0j)
        pattern = self._pattern
        data, gradient = angle_system(
            self._a,
            self._faces,
            w,
            frame,
            _SOFTENING,
            pattern.dofs,
            pattern.position,
            pattern.nnz,
            pattern.n,
        )
        data[self._analysis.diagonal] *= 1 + _DAMPING
        along = np.zeros((len(w), 2))
        along[self._free] = self._analysis.factor(data).solve(-gradient)
        step = (along[:, 0] + 1j * along[:, 1]) * frame
        keep_order(self._rim, w, step)
        return self._without_folds(w, slid(w, step, self._on_rim))

    def _without_folds(self, w: ComplexArray, to: ComplexArray) -> ComplexArray:
        still = np.zeros(len(w), dtype=np.bool_)
        for _ in range(_ATTEMPTS):
            bad = folded_vertices(to, self._every, self._holes)
            if not len(bad):
                return to
            still[bad] = True
            still = grow(still, self._every, 1)
            to = np.where(still, w, to)
        return w
