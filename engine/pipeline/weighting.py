"""Eq. (7)'s weights: per target, per point, and spread over the surface."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from engine.controls import distance_weights
from engine.pipeline.values import Controls, EditPlan, Prepared
from engine.restoration import vertex_weights
from engine.types import FloatArray, SurfacePoints


@dataclass(frozen=True, slots=True)
class Weights:
    """Eq. (7)'s alpha at time 1.

    ``points`` (targets, c); ``surface`` (targets, n), or (targets, 1) where all vertices agree.
    """

    points: FloatArray
    surface: FloatArray


def final_weights(
    plan: EditPlan,
    names: Sequence[str],
    per_target: Mapping[str, float],
    source: Prepared,
    controls: Controls,
    travels: FloatArray,
) -> Weights:
    """Alpha per target and control point, spread over the surface where points have their own.

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
        anchors = SurfacePoints(controls.points.face[which], controls.points.barycentric[which])
        field = vertex_weights(source.surface.mesh, anchors, own[which], general)
        corners = field[source.surface.mesh.faces[controls.points.face]]
        points[index] = (corners * controls.points.barycentric).sum(axis=1)
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
