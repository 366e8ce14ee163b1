"""Hinges: pairs of triangles with a common edge, and how much a jump of μ across each weighs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine.quasiconformal._smooth_kernels import hinge_corners, opposite_sides
from engine.types import ComplexArray, FloatArray, IntArray

_TOTAL_WEIGHT = 1.5


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
    """All hinges of an oriented manifold mesh with plane positions ``z``, triangle ``area`` (m,)."""
    opposite = opposite_sides(faces, len(z))
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
    if not len(first):
        return np.zeros(0)
    tail, head = faces.ravel()[first], np.roll(faces, -1, axis=1).ravel()[first]
    centre = z[faces].mean(axis=1)
    dual = np.abs(centre[first // 3] - centre[second // 3])
    weight = np.abs(z[tail] - z[head]) / np.where(dual > 0.0, dual, np.inf)
    return weight * (_TOTAL_WEIGHT / weight.sum())
