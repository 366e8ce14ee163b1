"""The default correspondence: coarse-to-fine non-rigid registration, then projection."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine.correspondence._confidence import confidence
from engine.correspondence._fitting import Landmarks, Target, fit
from engine.correspondence._levels import Level, build_level
from engine.correspondence._loops import LoopPair, pair_loops
from engine.correspondence._plan import Plan, choose_plan
from engine.correspondence._projection import project
from engine.errors import RegistrationError
from engine.operators import face_areas, vertex_normals
from engine.types import Correspondence, FloatArray, Mesh, Registration, Surface, SurfacePoints

_COARSE = 2300
_FINE = 12_000


def nonrigid_correspondence(
    source: Surface,
    target: Surface,
    registration: Registration,
    landmarks: tuple[SurfacePoints, SurfacePoints] | None,
) -> Correspondence:
    """See :func:`engine.correspondence.correspond`."""
    frame = _Frame.of(source.mesh)
    rest = source.mesh.moved(frame(source.mesh.vertices))
    aligned = registration.source_from_target(target.mesh.vertices)
    goal = Target(target.mesh.moved(frame(aligned)))
    loops = pair_loops(rest, source.loops, goal.mesh, target.loops)
    plan = choose_plan(rest, goal, loops)
    marks = None if landmarks is None else (landmarks[0], landmarks[1].on(goal.mesh))
    deformed = _deform(rest, source, goal, loops, plan, marks)
    projection = project(rest.moved(deformed), goal, loops, landmarks, rest)
    return Correspondence(projection.points, confidence(rest, projection, goal), plan.mode)


@dataclass(frozen=True, slots=True)
class _Frame:
    """Lengths in square roots of the source's area, origin at its mean vertex."""

    centre: FloatArray
    unit: float

    @classmethod
    def of(cls, mesh: Mesh) -> _Frame:
        area = float(face_areas(mesh).sum())
        if area <= 0:
            raise RegistrationError(
                "the source surface has no area, so nothing on it can correspond",
                code="no_surface",
                elements={"face_count": len(mesh.faces)},
            )
        return cls(mesh.vertices.mean(axis=0), float(np.sqrt(area)))

    def __call__(self, points: FloatArray) -> FloatArray:
        return (points - self.centre) / self.unit


def _deform(
    rest: Mesh,
    source: Surface,
    goal: Target,
    loops: tuple[LoopPair, ...],
    plan: Plan,
    marks: tuple[SurfacePoints, FloatArray] | None,
) -> FloatArray:
    """Positions (n, 3) of the source's vertices on the target's shape."""
    x = rest.vertices
    for count, steps in ((_COARSE, plan.coarse), (_FINE, plan.fine)):
        level = build_level(rest, source.loops, count)
        start = x[level.number >= 0]
        fitted = fit(
            level.surface,
            start,
            goal,
            steps,
            loops=[pair.restricted(level.number) for pair in loops],
            landmarks=_landmarks_on(level, rest, marks),
            weights=plan.weights,
        )
        x = level.prolong(fitted, rest)
    return x


def _landmarks_on(
    level: Level, rest: Mesh, marks: tuple[SurfacePoints, FloatArray] | None
) -> Landmarks | None:
    if marks is None:
        return None
    ours, goals = marks
    normals = SurfacePoints(ours.face, ours.barycentric).on(rest.moved(vertex_normals(rest)))
    return Landmarks(level.feet_of(ours.on(rest), normals), goals)
