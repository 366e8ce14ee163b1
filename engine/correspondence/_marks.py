"""Known pairs of points, as the fits of parts of a surface need them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine.nearest import NormalAwareIndex
from engine.operators import vertex_normals
from engine.types import BoolArray, FloatArray, Mesh, SurfacePoints

_TOUCHING = 1e-6


@dataclass(frozen=True, slots=True)
class Marks:
    """``points`` (k, 3) of the source at rest, its ``normals`` there, and their ``goals``."""

    points: FloatArray
    normals: FloatArray
    goals: FloatArray

    @classmethod
    def of(cls, source: Mesh, ours: SurfacePoints, goals: FloatArray) -> Marks:
        """The points ``ours`` of ``source``, which belong at ``goals``."""
        return cls(ours.on(source), ours.on(source.moved(vertex_normals(source))), goals)

    def only(self, chosen: BoolArray) -> Marks:
        """Those ``chosen`` (k,)."""
        return Marks(self.points[chosen], self.normals[chosen], self.goals[chosen])

    def touching(self, mesh: Mesh) -> Marks:
        """Those that lie on ``mesh``."""
        feet = NormalAwareIndex(mesh, 0.0).feet(self.points, self.normals)
        return self.only(feet.distance < _TOUCHING)


NO_MARKS = Marks(np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 3)))
