"""Eq. (7)'s weights: per target, per point, and spread over the surface."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from engine.controls import distance_weights
from engine.pipeline.values import Controls, EditPlan
from engine.restoration import PointWeights
from engine.types import FloatArray, IntArray, Mesh, SurfacePoints


@dataclass(frozen=True, slots=True)
class Weights:
    """Eq. (7)'s alpha at time 1.

    ``points`` (targets, c); ``surface`` (targets, n), or (targets, 1) where all vertices agree.
    """

    points: FloatArray
    surface: FloatArray


class Spreading:
    """How the values at some of an edit's control points spread over the source's surface.

    What does not depend on the values is found once for each choice of points.
    """

    def __init__(self, mesh: Mesh, points: SurfacePoints) -> None:
        self._mesh = mesh
        self._points = points
        self._known: dict[bytes, PointWeights] = {}

    def field(self, which: IntArray, values: FloatArray, background: float) -> FloatArray:
        """The weights (n,) with ``values`` at the points ``which`` and ``background`` elsewhere."""
        key = which.tobytes()
        if key not in self._known:
            points = SurfacePoints(self._points.face[which], self._points.barycentric[which])
            self._known[key] = PointWeights(self._mesh, points)
        return self._known[key].field(values, background)

    def at_points(self, field: FloatArray) -> FloatArray:
        """A field (n,) at every control point (c,)."""
        corners = field[self._mesh.faces[self._points.face]]
        return (corners * self._points.barycentric).sum(axis=1)


def final_weights(
    plan: EditPlan,
    names: Sequence[str],
    per_target: Mapping[str, float],
    controls: Controls,
    travels: FloatArray,
    spreading: Spreading,
) -> Weights:
    """Alpha per target and control point, spread over the surface where points have their own.

    There, requested points without a weight of their own hold the target's, so that their
    neighbours do not pull them along; automatic ones take what the surface has.
    ``travels`` (targets, c): how far each point travels, in the source file's units.
    """
    points = np.empty((len(names), len(controls.names)))
    surfaces: list[FloatArray] = []
    for index, name in enumerate(names):
        general = per_target.get(name, 0.0)
        own = _own_weights(plan, name, general, travels[index], len(names), controls.requested)
        which = np.flatnonzero(~np.isnan(own))
        if not len(which):
            points[index] = general
            surfaces.append(np.full(1, general))
            continue
        own[: controls.requested] = np.where(
            np.isnan(own[: controls.requested]), general, own[: controls.requested]
        )
        which = np.flatnonzero(~np.isnan(own))
        field = spreading.field(which, own[which], general)
        points[index] = spreading.at_points(field)
        points[index, which] = own[which]
        surfaces.append(field)
    count = max((len(field) for field in surfaces), default=1)
    spread = [np.broadcast_to(field, count) for field in surfaces]
    return Weights(points, np.array(spread).reshape(len(names), count))


def _own_weights(
    plan: EditPlan,
    target: str,
    general: float,
    travel: FloatArray,
    targets: int,
    requested: int,
) -> FloatArray:
    """The weights that points have of their own, NaN for those that take the target's."""
    own = np.full(len(travel), np.nan)
    if target in plan.distances:
        own[:] = distance_weights(plan.distances[target], travel, targets)
    for index, point in enumerate(plan.points[:requested]):
        if point.fixed:
            own[index] = 0.0
        elif target in point.weights:
            own[index] = point.weights[target] * (1.0 if not plan.keyframes else general)
        elif target in point.distances:
            at = travel[index : index + 1]
            own[index] = distance_weights(point.distances[target], at, targets)[0]
    return own
