"""Points on the surface that must land exactly: linear constraints on a factored energy."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from engine.errors import RestorationError
from engine.linalg import Factor
from engine.types import FloatArray, Mesh, SurfacePoints

_RANK = 1e-12  # relative eigenvalue below which constraints repeat each other


def point_matrix(mesh: Mesh, points: SurfacePoints) -> sp.csr_array:
    """B (k, n) with B x the positions of ``points`` on ``mesh`` with vertices x."""
    rows = np.repeat(np.arange(len(points)), 3)
    columns = mesh.faces[points.face].ravel()
    shape = (len(points), len(mesh.vertices))
    return sp.csr_array((points.barycentric.ravel(), (rows, columns)), shape=shape)


class ExactPoints:
    """min xᵀHx/2 - bᵀx subject to B x = p: a ``response`` (n, k) per point, a small dense system.

    Points that repeat each other (one face holds only three independent ones) are fine as long
    as what they ask agrees within ``tolerance``, an absolute length.
    """

    def __init__(self, factor: Factor, matrix: sp.csr_array, *, tolerance: float) -> None:
        self._matrix = matrix
        self._tolerance = tolerance
        self.response: FloatArray = factor.solve(matrix.T.toarray())
        self._met: FloatArray = matrix @ self.response
        values, vectors = np.linalg.eigh(self._met)
        kept = values > _RANK * values.max(initial=0.0)
        self._inverse = (vectors[:, kept] / values[kept]) @ vectors[:, kept].T

    def correct(self, x: FloatArray, positions: FloatArray) -> FloatArray:
        """The constrained minimum from the free one ``x`` (n, 3); ``positions`` (k, 3).

        Raises as ``forces``.
        """
        return x + self.response @ self.forces(positions - self._matrix @ x)

    def forces(self, ahead: FloatArray) -> FloatArray:
        """How much of each point's ``response`` (n, k) moves all of them by ``ahead`` (k, 3).

        Raises ``RestorationError`` (code ``contradictory_points``) naming points that cannot all
        be where they were sent.
        """
        forces = self._inverse @ ahead
        forces = forces + self._inverse @ (ahead - self._met @ forces)
        missed = np.linalg.norm(ahead - self._met @ forces, axis=1)
        bad = np.flatnonzero(missed > self._tolerance)
        if len(bad):
            raise RestorationError(
                f"{len(bad)} points share a place or a triangle with others that are sent "
                "elsewhere; remove one of each group or move it to another triangle",
                code="contradictory_points",
                elements={"points": bad[:100].tolist(), "missed_by": missed[bad[:100]].tolist()},
            )
        return forces
