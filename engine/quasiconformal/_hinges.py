"""Hinges: pairs of triangles with a common edge, and how much a jump of μ across each weighs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine._halfedge_kernels import opposite_halfedges
from engine.quasiconformal._smooth_kernels import hinge_corners
from engine.types import ComplexArray, FloatArray, IntArray

_MEAN_WEIGHT = 7.5e-5  # whatever their number, so that a finer mesh has the same energy
_REGULAR = 0.75  # area of equilateral triangles over edge times dual edge
_LARGE = 3.0  # medians of area beyond which a triangle counts as large
_SIZE_POWER, _RATIO_POWER = 0.6, 0.75
_TINY = np.finfo(np.float64).tiny


@dataclass(frozen=True, slots=True)
class Hinges:
    """Half-edges ``first`` and ``second`` (e,) along each interior edge, and its ``weight`` (e,).

    ``opposite`` (3m,) are the twins of all half-edges, -1 on the boundary. A triangle without
    neighbours has a hinge of its own, without weight, whose ``second`` is -1; so each of the m
    triangles is in ``count`` (m,) > 0 hinges.
    """

    opposite: IntArray
    first: IntArray
    second: IntArray
    weight: FloatArray
    count: IntArray

    def corners(self, faces: IntArray) -> IntArray:
        """Vertices (e, 4): the edge, the corner across it, the corner beyond it or -1."""
        return hinge_corners(faces, self.first, self.second)

    @property
    def pairs(self) -> IntArray:
        """The two triangles (., 2) of every interior edge."""
        joined = self.second >= 0
        return np.stack([self.first[joined], self.second[joined]], axis=1) // 3


def find_hinges(z: ComplexArray, faces: IntArray, area: FloatArray) -> Hinges:
    """All hinges of an oriented manifold mesh at ``z`` (n,) with triangles' ``area`` (m,)."""
    opposite = opposite_halfedges(faces, len(z))
    side = np.arange(faces.size)
    first = side[opposite > side]
    alone = np.flatnonzero((opposite.reshape(-1, 3) < 0).all(axis=1))
    first = np.concatenate([first, 3 * alone])
    second = opposite[first]
    weight = np.zeros(len(first))
    joined = second >= 0
    weight[joined] = _weights(z, faces, area, first[joined], second[joined])
    count = np.bincount(first // 3, minlength=len(faces))
    count += np.bincount(second[joined] // 3, minlength=len(faces))
    return Hinges(opposite, first, second, weight, count)


def _weights(
    z: ComplexArray, faces: IntArray, area: FloatArray, first: IntArray, second: IntArray
) -> FloatArray:
    """Edge over dual edge, as for ∫|∇μ|², but lighter where triangles are small or thin.

    A mesh is fine where skin folds and stretches, and thin triangles close holes. The powers were
    fitted to expressions of a face: there small triangles' μ jumps more than smoothness says.
    """
    if not len(first):
        return np.zeros(0)
    tail, head = faces.ravel()[first], np.roll(faces, -1, axis=1).ravel()[first]
    centre = z[faces].mean(axis=1)
    length = np.abs(z[tail] - z[head])
    dual = np.abs(centre[first // 3] - centre[second // 3])
    harmonic = 2.0 / (1.0 / area[first // 3] + 1.0 / area[second // 3])
    shape = np.minimum(harmonic / np.maximum(_REGULAR * length * dual, _TINY), 1.0)
    size = np.minimum(harmonic / np.median(harmonic), _LARGE)
    weight = shape * size**_SIZE_POWER * (length / np.maximum(dual, _TINY)) ** _RATIO_POWER
    return weight * (_MEAN_WEIGHT / weight.mean())
