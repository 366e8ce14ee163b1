"""The source on a target, and how it follows the target's points when they go elsewhere."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from engine._operator_kernels import doubled_normals
from engine.numbering import Numbering
from engine.operators import face_normals
from engine.restoration._constraints import ExactPoints
from engine.restoration._fit import Fit
from engine.types import FloatArray


@dataclass(frozen=True, slots=True)
class Held:
    """Points (k, n) that are met exactly, and the skin that brings data around them along."""

    points: sp.csr_array
    skin: ExactPoints


@dataclass(frozen=True)
class Carried:
    """The source in a target's shape: ``fitted`` (n, 3), and ``free`` of points met exactly.

    Both are in the ``numbering`` of the ``fit``.
    """

    numbering: Numbering
    fit: Fit
    held: Held | None
    free: FloatArray
    fitted: FloatArray

    @cached_property
    def shape(self) -> FloatArray:
        """The source's vertices (n, 3) in the target's shape."""
        return self.numbering.outside(self.fitted)

    def follower(self) -> Follower:
        """What follows other places of the same target."""
        return Follower(self)


class Follower:
    """Shapes for other places, from the rotations of the shape that there is.

    All that is left to do is linear: one back-substitution, and the held points' responses.
    """

    def __init__(self, carried: Carried) -> None:
        self._numbering, self._fit, self._held = carried.numbering, carried.fit, carried.held
        fit = carried.fit
        self._load = fit.load(carried.free)
        if carried.held is not None:
            self._turned_on = fit.drawn(0.0 * carried.free, fit.load(carried.fitted) - self._load)
            self._drawn = fit.drawn(carried.held.skin.response)
            self._exact = fit.exact_points()
        self._up = _upright(fit, carried.fitted)
        self._open = fit.opener()

    def at(self, looked_up: FloatArray, positions: FloatArray) -> FloatArray:
        """The shape for places (n, 3) and exact ``positions`` (k, 3) that differ a little."""
        found = self._followed(self._numbering.inside(looked_up), positions)
        return self._numbering.outside(found)

    def _followed(self, looked_up: FloatArray, positions: FloatArray) -> FloatArray:
        free = self._fit.solve_turned(self._load, looked_up)
        if self._held is None:
            return self._opened(free)
        forces = self._held.skin.forces(positions - self._held.points @ free)
        x = free + self._turned_on + self._drawn @ forces
        return self._opened(self._exact.correct(x, positions))

    def _opened(self, x: FloatArray) -> FloatArray:
        """``x`` (n, 3), looked at closely only if a triangle shows its other side."""
        doubled = doubled_normals(x, self._fit.mesh.faces)
        upright = np.einsum("ma,ma->m", doubled, self._up)
        return self._open(x) if (upright < 0).any() else x


def _upright(fit: Fit, x: FloatArray) -> FloatArray:
    """What is up on ``x`` (n, 3) at each triangle (m, 3); 0 where one is turned over already."""
    up, normals = fit.up(x), face_normals(fit.mesh.moved(x))
    return np.where((np.einsum("ma,ma->m", up, normals) > 0)[:, None], up, 0.0)
