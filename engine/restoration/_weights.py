"""Weights given at points, spread over the surface."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.special import k0

from engine.linalg import SymmetricPattern
from engine.operators import adjacency, cotangent_laplacian, vertex_areas
from engine.restoration._constraints import point_matrix
from engine.restoration._elastic import diagonal
from engine.types import FloatArray, Mesh, SurfacePoints

_HEAT_LENGTH = 0.03  # of the diagonal: distances are exact to first order in it
_CUTOFF = 3.0  # reaches after which a point's influence ends
_POWER = 5
_NEAREST = 20  # nearly the maximum norm: many points reach little farther than the nearest one
_LEAST_COTANGENT = 0.02  # positive: heat must be positive everywhere


def vertex_weights(
    mesh: Mesh,
    points: SurfacePoints,
    values: FloatArray,
    background: float,
    *,
    reach: float = 0.09,
) -> FloatArray:
    """A smooth field (n,) with ``values`` (k,) at ``points`` and ``background`` far from them.

    Bounded by the values and the background; interpolated in a point's face it is the point's
    value (points so close that no bounded field meets both get a compromise). It falls off within
    about one ``reach`` (of the bounding box's diagonal) along the surface, so never across a
    closed mouth or eye, and is exactly the background from three reaches on. Shepard's weights
    with a compact support (Franke and Little), over distances that follow the surface; the
    background gives way to the nearest point, not to their number.
    """
    return PointWeights(mesh, points, reach=reach).field(values, background)


class PointWeights:
    """Points whose influence over the surface is known, for many values at them."""

    def __init__(self, mesh: Mesh, points: SurfacePoints, *, reach: float = 0.09) -> None:
        self._matrix = point_matrix(mesh, points)
        near = np.zeros((len(mesh.vertices), 0))
        if len(points):
            distance = _surface_distances(mesh, self._matrix)
            near = np.maximum(reach * diagonal(mesh.vertices) / distance - 1.0 / _CUTOFF, 0.0)
        nearest = (near**_NEAREST).sum(axis=1) ** (_POWER / _NEAREST)
        near = near**_POWER
        rest = 1.0 / (nearest + 1.0)
        total = near.sum(axis=1)
        of_points = np.divide(1.0 - rest, total, out=np.zeros_like(total), where=total > 0)
        self.shares: FloatArray = near * of_points[:, None]
        """(n, k) in [0, 1]: of each vertex's weight, what each point's value makes up."""

        self.background: FloatArray = rest
        """(n,) in [0, 1]: and what the background does."""

    def field(self, values: FloatArray, background: float) -> FloatArray:
        """The field (n,) with ``values`` (k,) at the points, as ``vertex_weights``."""
        if not len(values):
            return np.full(len(self.background), float(background))
        field = self.shares @ values + background * self.background
        low, high = min(values.min(), background), max(values.max(), background)
        return _interpolating(self._matrix, values, np.clip(field, low, high), (low, high))


def _surface_distances(mesh: Mesh, matrix: sp.csr_array) -> FloatArray:
    """Distances (n, k) along the surface from the points that ``matrix`` (k, n) interpolates.

    In the plane (1 - s^2 Laplacian) u = delta has the answer u = K0(d / s) / (2 pi s^2); on the
    surface it is solved for u and read backwards (after Varadhan, 1967).
    """
    n = len(mesh.vertices)
    step = _HEAT_LENGTH * diagonal(mesh.vertices)
    areas = vertex_areas(mesh)
    ring = adjacency(mesh.faces, n)
    rows = np.repeat(np.arange(n), np.diff(ring.indptr))
    cotangents = -np.asarray(cotangent_laplacian(mesh)[rows, ring.indices])
    ring.data = np.maximum(cotangents, _LEAST_COTANGENT)
    laplacian = sp.diags_array(ring.sum(axis=1)) - ring
    pattern, data = SymmetricPattern.of(sp.diags_array(areas) + step**2 * laplacian)
    heat = pattern.factor(data).solve(matrix.T.toarray())
    table = np.geomspace(1e-6, 600.0, 4000)
    logarithm = np.log(k0(table))
    tiny = np.exp(logarithm[-1]) / step**2
    reading = np.log(2 * np.pi * step**2 * np.maximum(heat, tiny))
    return step * np.exp(np.interp(-reading, -logarithm, np.log(table)))


def _interpolating(
    matrix: sp.csr_array, values: FloatArray, field: FloatArray, bounds: tuple[float, float]
) -> FloatArray:
    """``field`` with the least change at the points' corners that meets their ``values``.

    Within the bounds: what would leave them stays there, and the other corners make up for it.
    """
    free = np.unique(matrix.indices[matrix.data > 0])
    field = field.copy()
    while len(free):
        missing = values - matrix @ field
        step = np.linalg.lstsq(matrix[:, free].toarray(), missing, rcond=1e-10)[0]
        wanted = field[free] + step
        field[free] = np.clip(wanted, *bounds)
        outside = (wanted < bounds[0]) | (wanted > bounds[1])
        if not outside.any():
            break
        free = free[~outside]
    return field
