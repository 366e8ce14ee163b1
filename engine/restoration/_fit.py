"""One target's places fitted by an elastic surface, and fitted again when they change."""

from __future__ import annotations

import copy
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from engine.linalg import Factor
from engine.operators import adjacency
from engine.restoration._constraints import ExactPoints, point_matrix
from engine.restoration._elastic import Elastic
from engine.restoration._rotation_kernels import nearest_rotations
from engine.restoration._turned import turned_faces
from engine.types import FloatArray, IntArray, SurfacePoints

ExactTargets = tuple[SurfacePoints, FloatArray]

_STRETCH = 0.1  # of carrying: bending governs up to some 3 elastic lengths, stretching beyond
_TETHER = 1e-9  # of the areas: what is known nowhere keeps the source's place
_PASSES = 4  # of positions and rotations in turn
_PASSES_AGAIN = 1
_LEAST_SCALE = 1e-3
_NOISE = 4e-4  # of the diagonal: the usual misfit of clean data is well below this
_NOISIEST = 6.0  # times that: the elastic length grows to at most 2.5 times itself
_YIELDING = 0.05  # confidence left to data that turns triangles over
_REPAIRS = 3
EXACT = 1e-9  # of the diagonal


class Fit:
    """One target's data and their confidence, and what is solved again and again with them."""

    def __init__(
        self, elastic: Elastic, length: float, data: FloatArray, trust: FloatArray
    ) -> None:
        self._elastic = elastic
        self._length = length
        self._weights = {"bend": length**4, "stretch": _STRETCH * length**2}
        self._trust = trust
        self.data = data
        self._scale, self.start = self._common_motion()
        self._factor = self._factored()

    def _common_motion(self) -> tuple[float, FloatArray]:
        """The best similarity's scale, and the source moved by it."""
        source = self._elastic.mesh.vertices
        weight = self._trust * self._elastic.areas
        weight = weight / weight.sum()
        centre, new_centre = weight @ source, weight @ self.data
        before, after = source - centre, self.data - new_centre
        rotation = nearest_rotations((after.T @ (weight[:, None] * before))[None])[0]
        turned = before @ rotation.T
        spread = float(weight @ (before**2).sum(axis=1))
        scale = float(weight @ (after * turned).sum(axis=1)) / spread if spread > 0 else 1.0
        scale = max(scale, _LEAST_SCALE)
        return scale, scale * turned + new_centre

    def _factored(self) -> Factor:
        areas = self._elastic.areas
        self._hold = areas * self._trust
        return self._elastic.factor(**self._weights, hold=self._hold + _TETHER * areas)

    def solve(
        self, x: FloatArray, exact: ExactTargets | None, *, passes: int = _PASSES
    ) -> FloatArray:
        """Minimise over positions and rotations in turn, the rotations first taken from ``x``."""
        elastic = self._elastic
        rest = elastic.mesh.vertices
        held = self._hold[:, None] * self.data + (_TETHER * elastic.areas)[:, None] * self.start
        hard = None
        if exact:
            matrix = point_matrix(elastic.mesh, exact[0])
            hard = ExactPoints(self._factor, matrix, tolerance=EXACT * elastic.size)
        for _ in range(passes):
            turns = elastic.turns(rest, x, self._scale)
            x = self._factor.solve(elastic.load(rest, turns, **self._weights) + held)
            if exact and hard:
                x = hard.correct(x, exact[1])
        return x

    def allow_for_noise(self, x: FloatArray) -> bool:
        """Trust all data less when most are off their fit ``x`` by more than forms explain.

        The elastic length so grows with the root of the noise. Says whether anything changed.
        """
        known = self._trust > 0
        off = float(np.median(np.linalg.norm(self.data[known] - x[known], axis=1)))
        noise = off / (_NOISE * self._scale * self._elastic.size)
        if noise <= 1:
            return False
        self._trust = self._trust / min(noise, _NOISIEST) ** 2
        self._factor = self._factored()
        return True

    def distrust(self, faces: IntArray) -> None:
        """Lower the confidence of the data within two rings of ``faces``."""
        near = np.zeros(len(self._trust))
        near[self._elastic.mesh.faces[faces]] = 1.0
        ring = adjacency(self._elastic.mesh.faces, len(near))
        near = near + ring @ (near + ring @ near)
        self._trust = np.where(near > 0, _YIELDING * self._trust, self._trust)
        self._factor = self._factored()

    def repaired(self, x: FloatArray, exact: ExactTargets | None) -> FloatArray:
        """``x`` (n, 3), or the fit with less trust in data that turn triangles over."""
        mesh = self._elastic.mesh
        turned = turned_faces(mesh, mesh.vertices, x)
        for _ in range(_REPAIRS):
            if not len(turned):
                break
            self.distrust(turned)
            better = self.solve(x, exact)
            still = turned_faces(mesh, mesh.vertices, better)
            if len(still) >= len(turned):
                break
            x, turned = better, still
        return x

    def following(self, looked_up: FloatArray) -> Fit:
        """The same trust in other places (n, 3)."""
        other = copy.copy(self)
        other.data = np.where(self._trust[:, None] > 0, looked_up, 0.0)
        return other


@dataclass(frozen=True, slots=True)
class Held:
    """Points that are met exactly, and the skin that brings data around them along."""

    points: SurfacePoints
    matrix: sp.csr_array
    skin: ExactPoints


@dataclass(frozen=True, slots=True)
class Carried:
    """The source (n, 3) in a target's ``shape``; ``free`` of the points that it meets exactly."""

    fit: Fit
    held: Held | None
    free: FloatArray
    shape: FloatArray

    def again(self, looked_up: FloatArray, positions: FloatArray) -> FloatArray:
        """The shape for places (n, 3) and exact ``positions`` (k, 3) that differ a little.

        Rotations start from the shape that there is, so one pass does for what took four.
        """
        fit = self.fit.following(looked_up)
        free = fit.solve(self.free, None, passes=_PASSES_AGAIN)
        if self.held is None:
            return free
        ahead = positions - self.held.matrix @ free
        fit.data = fit.data + self.held.skin.correct(np.zeros_like(free), ahead)
        exact = (self.held.points, positions)
        return fit.solve(self.shape, exact, passes=_PASSES_AGAIN)
