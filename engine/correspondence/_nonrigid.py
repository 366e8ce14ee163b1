"""The default correspondence: coarse-to-fine non-rigid registration, then projection."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from engine.correspondence._confidence import confidence
from engine.correspondence._fitting import Fitting, Landmarks, Target
from engine.correspondence._levels import Level, build_level
from engine.correspondence._loops import LoopPair, pair_loops
from engine.correspondence._plan import Plan, choose_plan
from engine.correspondence._projection import project
from engine.errors import RegistrationError
from engine.operators import face_areas, vertex_normals
from engine.types import (
    Correspondence,
    FloatArray,
    IntArray,
    Mesh,
    Registration,
    Surface,
    SurfacePoints,
)

_COARSE = 2300
_FINE = 12_000
_EXACTING = 5.0  # landmarks weigh this much more once the surfaces nearly coincide


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
    task = _Task(rest, source.loops, goal, loops, plan, marks)
    projection = project(rest.moved(task.deform()), goal, loops, landmarks, rest)
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


@dataclass(frozen=True, slots=True)
class _Task:
    """One pair of aligned surfaces; ``marks``: points of the source, where they go."""

    rest: Mesh
    source_loops: tuple[IntArray, ...]
    goal: Target
    loops: tuple[LoopPair, ...]
    plan: Plan
    marks: tuple[SurfacePoints, FloatArray] | None

    def deform(self) -> FloatArray:
        """Positions (n, 3) of the source's vertices on the target's shape."""
        x = self.rest.vertices
        weights = self.plan.weights
        exacting = replace(weights, landmark=_EXACTING * weights.landmark)
        levels = ((_COARSE, self.plan.coarse, weights), (_FINE, self.plan.fine, exacting))
        for count, steps, level_weights in levels:
            level = build_level(self.rest, self.source_loops, count)
            fitting = Fitting(
                level.surface,
                self.goal,
                tuple(pair.restricted(level.number) for pair in self.loops),
                self._landmarks(level),
                level_weights,
                self.plan.static[level.number >= 0],
            )
            x = level.prolong(fitting.run(x[level.number >= 0], steps), self.rest)
        return x

    def _landmarks(self, level: Level) -> Landmarks | None:
        if self.marks is None:
            return None
        ours, goals = self.marks
        normals = ours.on(self.rest.moved(vertex_normals(self.rest)))
        return Landmarks(level.feet_of(ours.on(self.rest), normals), goals)
