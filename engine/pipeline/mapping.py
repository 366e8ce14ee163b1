"""Plane maps of an edit: one analysed problem, every target and frame solved on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from engine.beltrami import beltrami_coefficient, folds
from engine.errors import QuasiconformalError
from engine.insertion import RefinedPlane, insert_points
from engine.pipeline.controlling import keep_controls
from engine.pipeline.planes import TargetPlane, boundary_angles
from engine.pipeline.values import Controls, Options, Prepared
from engine.quasiconformal import QuasiconformalSolver, compatible_points
from engine.types import BoolArray, ComplexArray, FloatArray, IntArray, PlaneMap, SurfacePoints

MOST_DROPS = 8


@dataclass(frozen=True, slots=True)
class Boundary:
    """How the outer boundary moves: its vertices, and per target their angles' shift.

    Empty ``vertices``: the boundary is free.
    """

    vertices: IntArray
    start: ComplexArray
    shifts: FloatArray

    def at(self, alpha: FloatArray) -> ComplexArray:
        """Plane positions for weights ``alpha`` (targets, b) or (targets, 1)."""
        return self.start * np.exp(1j * (alpha * self.shifts).sum(axis=0))


def edit_boundary(source: Prepared, planes: Sequence[TargetPlane], options: Options) -> Boundary:
    """Sliding with the targets' outer loops where they correspond, else fixed or free."""
    loop = source.disk.surface.boundary
    start = source.disk.z[loop]
    still = np.zeros((len(planes), len(loop)))
    if options.outer_boundary in {"fixed", "paper"} or not planes:
        return Boundary(loop, start, still)
    free = Boundary(loop[:0], start[:0], still[:, :0])
    if options.outer_boundary == "free":
        return free
    angles = [boundary_angles(source, plane) for plane in planes]
    matched = [found for found in angles if found is not None]
    if len(matched) == len(angles):
        own = np.unwrap(np.angle(start))
        return Boundary(loop, start, np.array(matched) - own)
    if options.outer_boundary == "matched":
        raise QuasiconformalError(
            "outer_boundary 'matched' was asked for, but the outer boundaries do not correspond; "
            "use 'default', 'fixed' or 'free'",
            code="boundary_not_matched",
        )
    return free


class PlaneProblem:
    """The source disk under one set of control points: solve for any of their positions."""

    def __init__(
        self, source: Prepared, controls: Controls, boundary: Boundary, options: Options
    ) -> None:
        self._source = source
        self.controls = controls
        self.boundary = boundary
        disk = source.disk
        self._plane: RefinedPlane = insert_points(
            disk.z, disk.surface.mesh.faces, on_disk(source, controls.points)
        )
        corners = disk.z[disk.surface.mesh.faces]
        self._corners = corners
        self._solver = QuasiconformalSolver(
            self._plane.z,
            self._plane.faces,
            np.concatenate([boundary.vertices, self._plane.vertices]),
            method=options.iteration,
        )

    def map(
        self, targets: ComplexArray, boundary: ComplexArray, start: ComplexArray | None
    ) -> tuple[PlaneMap, ComplexArray]:
        """The plane map that takes the control points to ``targets``.

        Returns it on the source disk's own vertices, and on the refined plane for a warm start.
        """
        solved = self._solver.map(np.concatenate([boundary, targets]), start=start)
        disk = self._source.disk
        faces = disk.surface.mesh.faces
        z = solved.z[: len(disk.z)]
        own = PlaneMap(
            z,
            beltrami_coefficient(self._corners, faces, z),
            solved.residuals,
            solved.solves,
            solved.converged,
            folds(self._corners, faces, z),
        )
        return own, solved.z

    def residual(self, solved: ComplexArray, targets: ComplexArray) -> float:
        """The largest distance between a control point and where it was sent."""
        reached = solved[self._plane.vertices]
        return float(np.abs(reached - targets).max(initial=0.0))


def on_disk(source: Prepared, points: SurfacePoints) -> SurfacePoints:
    """Surface points on the disk's own faces."""
    face_of = np.full(len(source.surface.mesh.faces), -1)
    face_of[source.disk.surface.face] = np.arange(len(source.disk.surface.face))
    face = face_of[points.face]
    surface_corners = source.surface.mesh.faces[points.face]
    vertex = source.disk.surface.vertex
    disk_corners = vertex[source.disk.surface.mesh.faces[face]]
    same = disk_corners[:, :, None] == surface_corners[:, None, :]
    return SurfacePoints(face, np.einsum("kij,kj->ki", same, points.barycentric))


def solve_targets(
    source: Prepared, controls: Controls, boundary: Boundary, options: Options
) -> tuple[PlaneProblem, list[tuple[PlaneMap, ComplexArray]]]:
    """One map per target; automatic points that contradict the others are left out.

    Raises QuasiconformalError naming the request's points when those cannot all be met.
    """
    targets = len(controls.plane_targets)
    if options.iteration == "default":
        controls = _compatible(source, controls, boundary)
    for _ in range(MOST_DROPS):
        problem = PlaneProblem(source, controls, boundary, options)
        maps: list[tuple[PlaneMap, ComplexArray]] = []
        try:
            for index in range(targets):
                alpha = np.zeros((targets, 1))
                alpha[index] = 1.0
                where = boundary.at(alpha)
                maps.append(problem.map(controls.plane_targets[index], where, None))
        except QuasiconformalError as error:
            controls = _without_contradictory(controls, boundary, error)
            continue
        return problem, maps
    raise QuasiconformalError(
        "the control points contradict each other in the plane; use fewer automatic points",
        code="not_reached",
        elements={"points": list(controls.names[: controls.requested])},
    )


def _compatible(source: Prepared, controls: Controls, boundary: Boundary) -> Controls:
    """Drop automatic points whose neighbourhoods the targets turn over."""
    keep = np.ones(len(controls.names), dtype=bool)
    requested = np.arange(len(keep)) < controls.requested
    start = np.concatenate([boundary.start, controls.plane])
    trusted = np.concatenate([np.ones(len(boundary.start), dtype=bool), requested])
    targets = len(controls.plane_targets)
    for index, ends in enumerate(controls.plane_targets):
        where = boundary.at(np.eye(targets)[:, index : index + 1])
        kept = compatible_points(start, np.concatenate([where, ends]), trusted)
        keep &= kept[len(boundary.start) :] | requested
    return keep_controls(controls, np.flatnonzero(keep))


def _without_contradictory(
    controls: Controls, boundary: Boundary, error: QuasiconformalError
) -> Controls:
    """Leave out the automatic points that an error names; raise it when they are not the cause."""
    named = np.asarray(error.elements.get("points", []), dtype=np.int64) - len(boundary.vertices)
    named = named[named >= 0]
    automatic = named[named >= controls.requested]
    if not len(automatic):
        names = [controls.names[index] for index in named]
        raise QuasiconformalError(
            f"control points {', '.join(names[:5]) or '(boundary)'} cannot all be met: {error}",
            code=error.code,
            elements={"points": names},
        ) from error
    keep: BoolArray = np.ones(len(controls.names), dtype=bool)
    keep[automatic] = False
    return keep_controls(controls, np.flatnonzero(keep))
