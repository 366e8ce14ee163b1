"""A plane mesh to map, with all that does not depend on control points; and its constraints."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from engine._beltrami_kernels import wirtinger_weights
from engine._distortion_kernels import area_ratios
from engine.beltrami import folds, orientations
from engine.distortion import slid
from engine.errors import EngineError, QuasiconformalError
from engine.linalg import ElementPattern, Keep, SymmetricPattern
from engine.quasiconformal._hinges import Hinges, find_hinges
from engine.types import BoolArray, ComplexArray, FloatArray, IntArray, frozen_array

_OFF_CIRCLE = 1e-9


class PreparedPlane:
    """A plane mesh ``z`` (n,) with counter-clockwise ``faces`` (m, 3), ready to be mapped.

    Whatever depends on the mesh alone is computed once, when it is first needed: hinges, and the
    symbolic analysis of the systems that every set of control points shares, which ``keep`` may
    have from before. Raises
    QuasiconformalError ``domain_folded`` if a face is flat or turned over.
    """

    def __init__(self, z: ComplexArray, faces: IntArray, keep: Keep | None = None) -> None:
        self._keep = keep
        self.z: ComplexArray = frozen_array(z, np.complex128)
        self.faces: IntArray = frozen_array(faces, np.int64)
        corners = self.z[self.faces]
        turned = np.flatnonzero(orientations(corners) <= 0)
        if len(turned):
            raise QuasiconformalError(
                f"{len(turned)} triangles of the plane are flat or turned over, first"
                f" {turned[0]}; repair the disk map first",
                code="domain_folded",
                elements={"faces": turned[:100].tolist()},
            )
        self.a, self.area = wirtinger_weights(corners)

    @cached_property
    def hinges(self) -> Hinges:
        """Pairs of triangles with a common edge."""
        return find_hinges(self.z, self.faces, self.area)

    @cached_property
    def elements(self) -> ElementPattern:
        """The pattern of one unknown per vertex, coupled across hinges."""
        return ElementPattern(self.hinges.corners(self.faces), len(self.z))

    @cached_property
    def analysis(self) -> SymmetricPattern:
        """The symbolic analysis of ``elements``."""
        return self.elements.analyse(self._keep)

    @cached_property
    def boundary_edges(self) -> IntArray:
        """Directed edges (b, 2) of one face only, the mesh on their left."""
        alone = np.flatnonzero(self.hinges.opposite < 0)
        face, corner = alone // 3, alone % 3
        return np.stack([self.faces[face, corner], self.faces[face, (corner + 1) % 3]], axis=1)

    @cached_property
    def on_boundary(self) -> BoolArray:
        """Which vertices (n,) are on the boundary."""
        on = np.zeros(len(self.z), np.bool_)
        on[self.boundary_edges] = True
        return on

    def area_ratios(self, w: ComplexArray) -> FloatArray:
        """Area of each triangle's image over its own, negative where it is turned over."""
        return area_ratios(self.a, self.faces, w)

    def folds(self, w: ComplexArray) -> IntArray:
        """Faces that ``w`` turns over or flattens, exactly."""
        return folds(self.z[self.faces], self.faces, w)


@dataclass(frozen=True, slots=True)
class Constraints:
    """What may move: ``points`` (c,) are given, ``sliding`` (n,) vertices stay on the unit circle.

    ``fixed`` (n,) marks ``points``.
    """

    points: IntArray
    fixed: BoolArray
    sliding: BoolArray

    @classmethod
    def of(cls, plane: PreparedPlane, points: IntArray, *, slides: bool) -> Constraints:
        """``points`` must be distinct; with ``slides`` what else of the boundary is on the circle
        stays there."""
        if len(np.unique(points)) != len(points):
            raise EngineError("points must be distinct vertices", code="shape")
        fixed = np.zeros(len(plane.z), np.bool_)
        fixed[points] = True
        sliding = np.zeros_like(fixed)
        if slides:
            sliding = plane.on_boundary & (np.abs(np.abs(plane.z) - 1.0) <= _OFF_CIRCLE) & ~fixed
        return cls(points, fixed, sliding)

    def allowed(self, w: ComplexArray, d: ComplexArray) -> ComplexArray:
        """``d`` (n,) without what would move fixed vertices, or sliding ones off the circle."""
        kept = np.where(self.fixed, 0.0, d)
        if self.sliding.any():
            tangent = 1j * w[self.sliding]
            kept[self.sliding] = tangent * (tangent.conjugate() * kept[self.sliding]).real
        return kept

    def moved(self, w: ComplexArray, step: ComplexArray, share: float) -> ComplexArray:
        """``w`` after ``share`` of ``step``, sliding vertices along their arcs."""
        return slid(w, step, self.sliding, share)
