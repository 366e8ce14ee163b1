"""One target's places fitted by an elastic surface."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp

from engine.linalg import Factor
from engine.restoration._constraints import ExactPoints
from engine.restoration._elastic import Elastic
from engine.restoration._patch import Effort
from engine.restoration._rotation_kernels import nearest_rotations
from engine.restoration._untangled import Untangler
from engine.types import FloatArray, IntArray, Mesh

_STRETCH = 0.1  # of carrying: bending governs up to some 3 elastic lengths, stretching beyond
_TETHER = 1e-9  # of the areas: what is known nowhere keeps the source's place
_PASSES = 4  # of positions and rotations in turn
_LEAST_SCALE = 1e-3
_NOISE = 1.8e-4  # of the diagonal: the usual misfit of clean data is well below this
_NOISIEST = 13.5  # times that: the elastic length grows to at most 3.7 times itself
_YIELDING = 0.05  # confidence left to data that turns triangles over
_REPAIRS = (2, 4, 6)  # rings around such triangles, one after the other while some are left
_EFFORT = 12  # moving vertices times steps for each vertex of the mesh
EXACT = 1e-9  # of the diagonal


class Fit:
    """One target's data and their confidence, and what is solved again and again with them.

    ``points`` (k, n): those that have to be met exactly in the end.
    """

    def __init__(
        self,
        elastic: Elastic,
        length: float,
        data: FloatArray,
        trust: FloatArray,
        points: sp.csr_array | None,
    ) -> None:
        self._elastic = elastic
        self._length = length
        self._weights = {"bend": length**4, "stretch": _STRETCH * length**2}
        self._trust = trust
        self._points = points
        self.data = data
        self._scale, self.start = self._common_motion()
        self._factor = self._factored()

    @property
    def mesh(self) -> Mesh:
        """The source."""
        return self._elastic.mesh

    def up(self, x: FloatArray) -> FloatArray:
        """The source's unit normals (m, 3), turned with their neighbourhoods to ``x`` (n, 3)."""
        return self._elastic.orientation.up(x)

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
        self._exact: ExactPoints | None = None
        return self._elastic.factor(**self._weights, hold=self._hold + _TETHER * areas)

    def solve(self, x: FloatArray, exact: FloatArray | None) -> FloatArray:
        """Minimise over positions and rotations in turn, the rotations first taken from ``x``.

        ``exact`` (k, 3): where the points end, if they are to be met.
        """
        for _ in range(_PASSES):
            x = self.solve_turned(self.load(x), self.data)
            x = x if exact is None else self.exact_points().correct(x, exact)
        return x

    def load(self, x: FloatArray) -> FloatArray:
        """What the rotations from the source to ``x`` (n, 3) ask of positions (n, 3)."""
        return self._elastic.load(self._elastic.rest, x, self._scale, **self._weights)

    def solve_turned(self, load: FloatArray, data: FloatArray) -> FloatArray:
        """Minimise over positions (n, 3) alone, under a ``load`` and with these ``data`` (n, 3)."""
        tether = (_TETHER * self._elastic.areas)[:, None] * self.start
        return self.drawn(np.where(self._trust[:, None] > 0, data, 0.0), load + tether)

    def drawn(self, data: FloatArray, load: FloatArray | float = 0.0) -> FloatArray:
        """Where ``data`` (n, c), as far as they are trusted, and a ``load`` draw the surface."""
        return self._factor.solve(self._hold[:, None] * data + load)

    def exact_points(self) -> ExactPoints:
        """What meets the points exactly."""
        if self._exact is None:
            assert self._points is not None
            tolerance = EXACT * self._elastic.size
            self._exact = ExactPoints(self._factor, self._points, tolerance=tolerance)
        return self._exact

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

    def distrust(self, faces: IntArray, rings: int) -> None:
        """Lower the confidence of the data within so many ``rings`` of ``faces``."""
        near = self._elastic.orientation.around(faces, rings)
        self._trust = np.where(near, _YIELDING * self._trust, self._trust)
        self._factor = self._factored()

    def repaired(self, x: FloatArray, exact: FloatArray | None) -> FloatArray:
        """``x`` (n, 3), or the fit with less trust in data that turn triangles over.

        What is turned over then still is opened in place.
        """
        orientation = self._elastic.orientation
        best, fewest = x, orientation.turned(x)
        turned = fewest
        for rings in _REPAIRS:
            if not len(turned):
                break
            self.distrust(turned, rings)
            x = self.solve(x, exact)
            turned = orientation.turned(x)
            if len(turned) < len(fewest):
                best, fewest = x, turned
        return self.opener()(best) if len(fewest) else best

    def opener(self) -> Callable[[FloatArray], FloatArray]:
        """What opens turned triangles of a surface (n, 3) in place and keeps the exact points."""
        rest = self.mesh.vertices
        untangler = Untangler.in_place(self._elastic, self._scale * rest, self._points)

        def opened(x: FloatArray) -> FloatArray:
            return untangler.untangled(x, effort=Effort(_EFFORT * len(rest)))

        return opened
