"""Points that the request placed on a target: the source goes there exactly."""

from __future__ import annotations

import numpy as np

from engine.pipeline.controlling import Requested
from engine.pipeline.planes import TargetPlane
from engine.pipeline.preparation import joined
from engine.pipeline.values import Prepared
from engine.types import FloatArray, SurfacePoints


def exact_points(
    asked: Requested, index: int, plane: TargetPlane, target: Prepared
) -> tuple[SurfacePoints, FloatArray] | None:
    """The source points that the request placed on a target, and where in the source's frame."""
    given, there = asked.given[index], asked.given_at[index]
    if not len(given):
        return None
    corners = plane.surface_vertices[target.surface.mesh.faces[there.face]]
    positions = np.einsum("ki,kij->kj", there.barycentric, corners)
    return joined(asked.points, given), positions
