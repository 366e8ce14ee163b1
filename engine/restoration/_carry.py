"""The source carried to a target, and the source moved by handles."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import cast

import numpy as np
import scipy.sparse as sp

from engine.errors import RestorationError
from engine.linalg import Factor, Keep
from engine.numbering import Numbering
from engine.restoration._beyond import Extrapolator
from engine.restoration._blend import Blender
from engine.restoration._constraints import ExactPoints, point_matrix
from engine.restoration._elastic import Elastic, Rest, diagonal
from engine.restoration._fit import EXACT, Fit
from engine.restoration._following import Carried, Held
from engine.restoration._skin import HeldSkin, skin_weights
from engine.restoration._untangled import Untangler
from engine.types import FloatArray, Mesh, SurfacePoints

_PASSES = 4  # of positions and rotations in turn


ExactTargets = tuple[SurfacePoints, FloatArray]


class Restorer:
    """Everything about a source that does not depend on targets, weights or handles.

    ``elastic_length``: details up to some three times this are the source's, larger forms the
    target's. ``reach``: how far a handle pulls the skin along. Both relative to the diagonal of
    the source's bounding box.
    """

    def __init__(self, mesh: Mesh, *, elastic_length: float = 0.004, reach: float = 0.06) -> None:
        self.mesh = mesh
        size = diagonal(mesh.vertices)
        self._length = elastic_length * size
        self._reach = reach * size
        self._tolerance = EXACT * size

    @cached_property
    def _numbering(self) -> Numbering:
        return Numbering(self.mesh)

    @cached_property
    def _elastic(self) -> Elastic:
        return Elastic(self._numbering.mesh)

    @cached_property
    def _skin(self) -> Factor:
        elastic = self._elastic
        return elastic.factor(**skin_weights(self._reach), hold=elastic.areas)

    def carry(
        self,
        looked_up: FloatArray,
        confidence: FloatArray,
        exact: ExactTargets | None = None,
    ) -> FloatArray:
        """The source (n, 3) in a target's shape, with its own details.

        ``looked_up`` (n, 3): each vertex's place on the target, in any rigid frame and scale.
        ``confidence`` (n,) in [0, 1] weighs them; where it is 0 the place is ignored and the
        surface continues smoothly. ``exact``: points of the source and positions (k, 3) that they
        reach within 1e-9 of the diagonal; data around them follow. A rigidly moved or scaled
        source is returned as it is. Where data turn triangles over, they are trusted less.

        Raises ``RestorationError``: ``nothing_known`` when fewer than three vertices have
        confidence, ``contradictory_points``.
        """
        return self.carried(looked_up, confidence, exact).shape

    def carried(
        self,
        looked_up: FloatArray,
        confidence: FloatArray,
        exact: ExactTargets | None = None,
    ) -> Carried:
        """What ``carry`` answers, ready to follow other places soon."""
        trust = np.clip(confidence, 0.0, 1.0)
        known = trust > 0
        if np.count_nonzero(known) < 3:
            raise RestorationError(
                "fewer than three vertices have a known place on the target: lower the "
                "correspondence's threshold or give points by hand",
                code="nothing_known",
                elements={"known": int(np.count_nonzero(known))},
            )
        numbering = self._numbering
        data = numbering.inside(np.where(known[:, None], looked_up, 0.0))
        matrix = None
        if exact and len(exact[0]):
            matrix = self._rows(exact[0])
        fit = Fit(self._elastic, self._length, data, numbering.inside(trust), matrix)
        free = fit.solve(fit.start, None)
        if fit.allow_for_noise(free):
            free = fit.solve(free, None)
        if exact is None or matrix is None:
            return Carried(numbering, fit, None, free, fit.repaired(free, None))
        positions = exact[1]
        skin = ExactPoints(self._skin, matrix, tolerance=self._tolerance)
        fit.data = data + skin.correct(np.zeros_like(free), positions - matrix @ free)
        shape = fit.repaired(fit.solve(free, positions), positions)
        return Carried(numbering, fit, Held(matrix, skin), free, shape)

    def blender(self, shapes: Sequence[FloatArray], keep: Keep | None = None) -> Extrapolator:
        """The source and ``shapes`` (n, 3) ready to be blended at many weights."""
        return Extrapolator(Blender(self.mesh, shapes, keep))

    def blend(self, shapes: Sequence[FloatArray], weights: FloatArray) -> FloatArray:
        """One blend of the source and ``shapes``, as ``Extrapolator.at``; for more hold one."""
        return self.blender(shapes).at(weights)

    def deform(
        self,
        points: SurfacePoints,
        positions: FloatArray,
        *,
        fixed: SurfacePoints | None = None,
        base: FloatArray | None = None,
    ) -> FloatArray:
        """The surface (n, 3) with ``points`` of the source at ``positions`` (k, 3), like skin.

        ``fixed`` points stay; what no point holds follows smoothly and falls back to ``base``
        (n, 3), by default the source itself, over the reach. Points and fixed points are met
        within 1e-9 of the diagonal; no face turns over or collapses where there is room for it.
        Raises ``RestorationError`` ``contradictory_points``, whose indices count ``points`` first,
        then ``fixed``.
        """
        return self.grip(points, fixed).at(positions, base)

    def grip(self, points: SurfacePoints, fixed: SurfacePoints | None = None) -> Grip:
        """The same ``points`` and ``fixed`` ones ready to be sent to many positions."""
        held = None if fixed is None else self._rows(fixed)
        pulled, elastic = self._rows(points), self._elastic
        return Grip(self._numbering, elastic, self._skin, self._reach, pulled, held)

    def _rows(self, points: SurfacePoints) -> sp.csr_array:
        """Where ``points`` are (k, n), over the vertices in the order in which they are solved."""
        return self._numbering.columns(point_matrix(self.mesh, points))


class Grip:
    """Points of a source that are held: their responses are solved for once.

    ``points`` (k, n) and those that are ``fixed``, in the ``numbering`` of ``elastic``.
    """

    def __init__(
        self,
        numbering: Numbering,
        elastic: Elastic,
        skin: Factor,
        reach: float,
        points: sp.csr_array,
        fixed: sp.csr_array | None,
    ) -> None:
        self._numbering = numbering
        self._elastic, self._skin, self._reach = elastic, skin, reach
        self._fixed, self._matrix = fixed, points
        if fixed is not None:
            self._matrix = cast(sp.csr_array, sp.vstack([points, fixed], format="csr"))
        self._points: ExactPoints | None = None
        if self._matrix.nnz:
            self._points = ExactPoints(skin, self._matrix, tolerance=EXACT * elastic.size)

    @cached_property
    def _untangler(self) -> Untangler:
        elastic = self._elastic
        return Untangler(HeldSkin.of(elastic, self._reach, self._matrix, elastic.mesh.vertices))

    def at(self, positions: FloatArray, base: FloatArray | None = None) -> FloatArray:
        """The surface (n, 3) with the points at ``positions`` (k, 3), as ``Restorer.deform``."""
        rest = self._elastic.rest
        if base is not None:
            rest = self._elastic.rest_of(self._numbering.inside(base))
        if self._points is None:
            return self._numbering.outside(rest.vertices)
        return self._numbering.outside(self._pulled(self._points, positions, rest))

    def _pulled(self, points: ExactPoints, positions: FloatArray, rest: Rest) -> FloatArray:
        elastic, weights, start = self._elastic, skin_weights(self._reach), rest.vertices
        if self._fixed is not None:
            positions = np.concatenate([positions, self._fixed @ start])
        x = start + points.correct(np.zeros_like(start), positions - self._matrix @ start)
        held = elastic.areas[:, None] * start
        for _ in range(_PASSES):
            load = elastic.load(rest, x, **weights)
            x = points.correct(self._skin.solve(load + held), positions)
        if not len(elastic.orientation.turned(x)):
            return x
        return self._untangler.untangled(x, start)
