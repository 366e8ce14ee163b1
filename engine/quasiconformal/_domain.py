"""The plane mesh that is mapped, with its constrained vertices: what every method starts from."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from engine._beltrami_kernels import wirtinger_weights
from engine.beltrami import folds, orientations
from engine.errors import EngineError, QuasiconformalError
from engine.quasiconformal._smooth_kernels import area_ratios
from engine.types import BoolArray, ComplexArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class PlaneDomain:
    """``z`` (n,) with counter-clockwise ``faces`` (m, 3); ``points`` (c,) distinct vertices.

    ``a`` (m, 3): weights of f_z. ``unknown`` (2n,): number of each coordinate of each vertex
    among the unknowns, -1 for those of ``points``; ``free`` the other vertices, ascending.
    """

    z: ComplexArray
    faces: IntArray
    points: IntArray
    a: ComplexArray = field(init=False)
    area: FloatArray = field(init=False)
    free: IntArray = field(init=False)
    unknown: IntArray = field(init=False)

    def __post_init__(self) -> None:
        corners = self.z[self.faces]
        turned = np.flatnonzero(orientations(corners) <= 0)
        if len(turned):
            raise QuasiconformalError(
                f"{len(turned)} triangles of the plane are flat or turned over, first"
                f" {turned[0]}; repair the disk map first",
                code="domain_folded",
                elements={"faces": turned[:100].tolist()},
            )
        if len(np.unique(self.points)) != len(self.points):
            raise EngineError("points must be distinct vertices", code="shape")
        free = np.ones(len(self.z), np.bool_)
        free[self.points] = False
        unknown = np.full((len(self.z), 2), -1, np.int64)
        unknown[free] = np.arange(2 * np.count_nonzero(free)).reshape(-1, 2)
        a, area = wirtinger_weights(np.ascontiguousarray(corners))
        for name, value in (
            ("a", a),
            ("area", area),
            ("free", np.flatnonzero(free)),
            ("unknown", unknown.ravel()),
        ):
            object.__setattr__(self, name, value)

    @property
    def unknowns(self) -> int:
        """Real unknowns: two per free vertex."""
        return 2 * len(self.free)

    def spread(self, x: FloatArray) -> ComplexArray:
        """The unknowns ``x`` as a displacement (n,) of all vertices."""
        step = np.zeros(len(self.z), np.complex128)
        step[self.free] = x[::2] + 1j * x[1::2]
        return step

    def area_ratios(self, w: ComplexArray) -> FloatArray:
        """Area of each triangle's image over its own, negative where it is turned over."""
        return area_ratios(self.a, self.faces, w)

    def folds(self, w: ComplexArray) -> IntArray:
        """Faces that ``w`` turns over or flattens, exactly."""
        return folds(self.z[self.faces], self.faces, w)

    def boundary_edges(self) -> IntArray:
        """Directed edges (b, 2) of one face only, the mesh on their left."""
        edges = np.stack([self.faces, np.roll(self.faces, -1, axis=1)], axis=2).reshape(-1, 2)
        key = edges[:, 0] * len(self.z) + edges[:, 1]
        opposite = edges[:, 1] * len(self.z) + edges[:, 0]
        return edges[~np.isin(key, opposite)]

    def on_boundary(self) -> BoolArray:
        """Which vertices (n,) are on the boundary."""
        on = np.zeros(len(self.z), np.bool_)
        on[self.boundary_edges()] = True
        return on
