"""Plane maps of an edit: one analysed problem, every target and frame solved on it."""

from __future__ import annotations

import copy
from collections.abc import Sequence

import numpy as np

from engine.beltrami import beltrami_coefficient, folds
from engine.errors import ControlPointError, QuasiconformalError
from engine.insertion import RefinedPlane, insert_points
from engine.linalg import Keep
from engine.pipeline.boundaries import edit_boundary, may_be_freed
from engine.pipeline.contradictions import (
    MOST_DROPS,
    compatible,
    hopeless,
    without_contradictory,
)
from engine.pipeline.controlling import (
    Candidates,
    Requested,
    all_controls,
    apart,
    candidates,
    spread_automatic,
    worst_automatic,
)
from engine.pipeline.planes import TargetPlane
from engine.pipeline.values import (
    Boundary,
    Controls,
    EditPlan,
    Options,
    PlacedPlane,
    Prepared,
    SolvedPlanes,
)
from engine.quasiconformal import PreparedPlane, QuasiconformalSolver
from engine.types import ComplexArray, FloatArray, IntArray, PlaneMap, SurfacePoints

MOST_SOLVES = 60  # while there are automatic points to leave out instead
DEFAULT_AUTO = 320
ROUNDS = (0.5, 0.25, 0.25)
FEWEST_FOR_ROUNDS = 64
ROUGHLY = 0.05  # tolerance of a map that only shows where points are missing


class PlaneProblem:
    """The source disk under one set of control points: solve for any of their positions.

    ``rough``: only to see where points are missing. ``keep``: of the plane's analysis.
    """

    def __init__(
        self,
        source: Prepared,
        controls: Controls,
        boundary: Boundary,
        options: Options,
        *,
        rough: bool = False,
        keep: Keep | None = None,
    ) -> None:
        self._source = source
        self._options = options
        self.controls = controls
        self.boundary = boundary
        disk = source.disk
        self._faces = _domain_faces(source, options)
        self._plane: RefinedPlane = insert_points(
            disk.z, self._faces, on_disk(source, controls.points)
        )
        self._corners = disk.z[self._faces]
        _refuse_equal(controls, self._plane.vertices)
        self._on_rim = np.isin(self._plane.vertices, boundary.vertices)
        self._rim_place = np.searchsorted(np.sort(boundary.vertices), self._plane.vertices)
        self._rim_order = np.argsort(boundary.vertices)
        self._held = np.concatenate([boundary.vertices, self._plane.vertices[~self._on_rim]])
        self._solver = QuasiconformalSolver(
            PreparedPlane(self._plane.z, self._plane.faces, keep),
            self._held,
            method="default" if rough and not options.literal_iteration else options.iteration,
            boundary="sliding" if options.outer_boundary == "sliding" else "free",
            tolerance=ROUGHLY if rough else None,
            max_solves=MOST_SOLVES if len(controls.names) > controls.requested else None,
        )

    @property
    def z(self) -> ComplexArray:
        """The refined plane: the source disk's vertices, then the points inserted."""
        return self._plane.z

    def goals(self, targets: ComplexArray, boundary: ComplexArray) -> ComplexArray:
        """``targets`` with control points on a constrained boundary where the boundary goes."""
        goals = targets.copy()
        if self._on_rim.any():
            goals[self._on_rim] = boundary[self._rim_order[self._rim_place[self._on_rim]]]
        return goals

    def map(
        self, goals: ComplexArray, boundary: ComplexArray, start: ComplexArray | None
    ) -> tuple[PlaneMap, ComplexArray]:
        """The plane map that takes the control points to ``goals``.

        Returns it on the source disk's own vertices, and on the refined plane for a warm start.
        """
        solved = self._solver.map(self._wanted(goals, boundary), start=start)
        faces = self._faces
        z = solved.z[: len(self._source.disk.z)]
        own = PlaneMap(
            z,
            beltrami_coefficient(self._corners, faces, z),
            solved.residuals,
            solved.solves,
            solved.converged,
            folds(self._corners, faces, z),
        )
        return own, solved.z

    def between(
        self,
        images: Sequence[ComplexArray],
        weights: FloatArray,
        goals: ComplexArray,
        boundary: ComplexArray,
    ) -> ComplexArray | None:
        """The refined plane on the way to several maps of it, for a start; None if it folds.

        What ``map`` is to hold is in place, unless only that makes folds.
        """
        w = self.z.copy()
        for weight, image in zip(weights, images, strict=True):
            w += weight * (image - self.z)
        placed = self.placed(w, goals, boundary)
        if placed is not None:
            return placed
        return None if self._folds(w) else w

    def placed(
        self, w: ComplexArray, goals: ComplexArray, boundary: ComplexArray
    ) -> ComplexArray | None:
        """The refined plane ``w`` with what ``map`` is to hold in place; None if it folds."""
        placed = w.copy()
        placed[self._held] = self._wanted(goals, boundary)
        return None if self._folds(placed) else placed

    def _wanted(self, goals: ComplexArray, boundary: ComplexArray) -> ComplexArray:
        return np.concatenate([boundary, goals[~self._on_rim]])

    def _folds(self, refined: ComplexArray) -> bool:
        faces = self._plane.faces
        return len(folds(self._plane.z[faces], faces, refined)) > 0

    def reached(self, refined: ComplexArray) -> ComplexArray:
        """Where the control points are on a solved refined plane."""
        return refined[self._plane.vertices]

    def anew(self) -> PlaneProblem:
        """The same with nothing kept of the maps before; see ``QuasiconformalSolver.anew``."""
        other = copy.copy(self)
        other._solver = self._solver.anew()
        return other

    def sent_to(self, controls: Controls) -> PlaneProblem:
        """The same points, which ``controls`` send elsewhere on the targets."""
        other = copy.copy(self)
        other.controls = controls
        return other

    def eased(self, error: QuasiconformalError, attempt: int) -> PlaneProblem:
        """The same problem without the automatic points that ``error`` speaks of, or near them.

        When there are none and no point of the request is to blame, the boundary is set free.
        """
        source, options, boundary = self._source, self._options, self.boundary
        try:
            controls = without_contradictory(self.controls, boundary, error, attempt)
        except QuasiconformalError as final:
            if final.elements.get("points") or not may_be_freed(boundary, options):
                raise
            return PlaneProblem(source, self.controls, boundary.freed(), options)
        return PlaneProblem(source, controls, boundary, options)


def _domain_faces(source: Prepared, options: Options) -> IntArray:
    """The faces that the plane map must not turn over.

    Hole fills are left out of the default: lids that close, lips that open are no distortion of
    the surface, and a rim that slips past its opposite must not tie the skin around it up. The
    paper's domain is a disk (so it excludes kept holes).
    """
    disk = source.disk.surface
    if options.literal_iteration:
        return disk.mesh.faces
    return disk.mesh.faces[: len(disk.face)]


def _refuse_equal(controls: Controls, vertices: IntArray) -> None:
    """Two control points at one place would have two goals."""
    order = np.argsort(vertices, kind="stable")
    same = np.flatnonzero(np.diff(vertices[order]) == 0)
    if len(same):
        first, second = (controls.names[order[same[0] + k]] for k in (0, 1))
        raise ControlPointError(
            f"control points {first!r} and {second!r} are at the same place: leave one out",
            code="duplicate_point",
            elements={"points": [first, second]},
        )


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


Solved = tuple[PlaneProblem, list[tuple[PlaneMap, ComplexArray]]]


def solve_with_automatic(
    plan: EditPlan,
    source: Prepared,
    targets: Sequence[Prepared],
    planes: Sequence[TargetPlane],
    requested: Requested,
) -> SolvedPlanes:
    """Choose the automatic points and map the source's plane to every target's.

    Half of the points are spread, the rest go in rounds to where the maps err most. A boundary
    that no map can follow is set free, unless the request says what it should do.
    """
    boundary = edit_boundary(source, planes, plan.options)
    found = candidates(source, planes, requested)

    def solve(along: Boundary) -> Solved:
        return _solve_in_rounds(plan, source, targets, planes, requested, found, along)

    try:
        problem, maps = solve(boundary)
    except QuasiconformalError as error:
        if error.elements.get("points") or not planes or not may_be_freed(boundary, plan.options):
            raise
        problem, maps = solve(boundary.freed())
    return SolvedPlanes(
        problem.controls,
        problem.boundary,
        tuple(own for own, _ in maps),
        tuple(refined for _, refined in maps),
    )


def _solve_in_rounds(
    plan: EditPlan,
    source: Prepared,
    targets: Sequence[Prepared],
    planes: Sequence[TargetPlane],
    requested: Requested,
    found: Candidates,
    boundary: Boundary,
) -> Solved:
    count = 0 if not planes else DEFAULT_AUTO if plan.auto is None else plan.auto
    rounds = (1.0,) if plan.options.literal_iteration or count < FEWEST_FOR_ROUNDS else ROUNDS
    chosen = apart(source, spread_automatic(source, found, round(count * rounds[0])))
    starts: list[ComplexArray] | None = None
    for share in rounds[1:]:
        controls = all_controls(plan, source, targets, planes, requested, chosen)
        _, maps = solve_targets(source, controls, boundary, plan.options, starts, rough=True)
        starts = [warm for _, warm in maps]
        more = worst_automatic(source, planes, starts, found, round(count * share))
        chosen = apart(source, np.concatenate([chosen, more]))
    controls = all_controls(plan, source, targets, planes, requested, chosen)
    return solve_targets(source, controls, boundary, plan.options, starts)


def solve_targets(
    source: Prepared,
    controls: Controls,
    boundary: Boundary,
    options: Options,
    starts: Sequence[ComplexArray] | None = None,
    *,
    rough: bool = False,
) -> Solved:
    """One map per target; automatic points that contradict the others are left out.

    Raises QuasiconformalError naming the request's points when those cannot all be met.
    """
    if not options.literal_iteration:
        controls = compatible(source, controls, boundary)
    for attempt in range(MOST_DROPS):
        problem = PlaneProblem(source, controls, boundary, options, rough=rough)
        try:
            return problem, _target_maps(problem, starts)
        except QuasiconformalError as error:
            controls = without_contradictory(controls, boundary, error, attempt)
    raise hopeless(controls)


def _target_maps(
    problem: PlaneProblem, starts: Sequence[ComplexArray] | None
) -> list[tuple[PlaneMap, ComplexArray]]:
    ends = problem.controls.plane_targets
    maps: list[tuple[PlaneMap, ComplexArray]] = []
    for index, alpha in enumerate(np.eye(len(ends))):
        where = problem.boundary.at(alpha[:, None])
        goals = problem.goals(ends[index], where)
        maps.append(problem.map(goals, where, None if starts is None else starts[index]))
    return maps


def solve_frame(
    problem: PlaneProblem,
    ends: ComplexArray,
    where: ComplexArray,
    start: ComplexArray | None,
) -> PlacedPlane:
    """One frame's plane: control points to ``ends``, the boundary to ``where``.

    Automatic points that contradict the others at these weights are left out of this frame.
    """
    kept, wanted = problem, ends
    for attempt in range(MOST_DROPS):
        edge = where[: len(kept.boundary.vertices)]
        goals = kept.goals(wanted, edge)
        try:
            solved, refined = kept.map(goals, edge, start)
        except QuasiconformalError as error:
            fewer = kept.eased(error, attempt)
            wanted = ends[np.isin(problem.controls.names, fewer.controls.names)]
            kept = fewer
            continue
        residual = float(np.abs(kept.reached(refined) - goals).max(initial=0.0))
        left_out = tuple(sorted(set(problem.controls.names) - set(kept.controls.names)))
        return PlacedPlane(solved, refined, problem.reached(refined), residual, left_out)
    raise hopeless(problem.controls)
