"""The public way in: one domain with its control points, many targets, three methods."""

from __future__ import annotations

import copy
from functools import cached_property
from typing import Literal

import numpy as np

from engine.beltrami import beltrami_coefficient
from engine.errors import EngineError, QuasiconformalError
from engine.quasiconformal._extremal import even_coefficient, least_maximum
from engine.quasiconformal._iteration import LiteralIteration
from engine.quasiconformal._limits import points_near_folds, refuse_impossible
from engine.quasiconformal._newton import Descent
from engine.quasiconformal._plane import Constraints, PreparedPlane
from engine.quasiconformal._staging import StagedDescent
from engine.types import ComplexArray, IntArray, PlaneMap

Method = Literal["default", "minimal", "teichmueller", "paper", "paper_teichmueller"]
_LITERAL = {"paper", "paper_teichmueller"}
_USUAL_SOLVES: dict[Method, int] = {
    "default": 200,
    "minimal": 120,
    "teichmueller": 200,
    "paper": 300,
    "paper_teichmueller": 300,
}
Boundary = Literal["free", "sliding"]


class QuasiconformalSolver:
    """Maps of one plane under one set of control points.

    ``points`` (c,) are distinct vertices of ``plane`` that every call of ``map`` sends to its
    targets. The options are those of ``quasiconformal_map``.
    """

    def __init__(
        self,
        plane: PreparedPlane,
        points: IntArray,
        *,
        method: Method = "default",
        boundary: Boundary = "free",
        tolerance: float | None = None,
        max_solves: int | None = None,
    ) -> None:
        self._plane = plane
        self._method: Method = method
        literal = method in _LITERAL
        if literal and boundary == "sliding":
            raise EngineError(f"method {method!r} has no sliding boundary", code="options")
        points = np.ascontiguousarray(points, np.int64)
        self._constraints = Constraints.of(plane, points, slides=boundary == "sliding")
        self._tolerance = (0.01 if literal else 1e-3) if tolerance is None else tolerance
        self._most = _USUAL_SOLVES[method] if max_solves is None else max_solves

    @cached_property
    def _staged(self) -> StagedDescent:
        return StagedDescent(self._plane, self._constraints)

    @cached_property
    def _literal(self) -> LiteralIteration:
        return LiteralIteration(self._plane, self._constraints.points)

    def anew(self) -> QuasiconformalSolver:
        """The same without what it keeps of the maps before: answers depend on nothing else."""
        other = copy.copy(self)
        if self._method not in _LITERAL:
            other._staged = StagedDescent(self._plane, self._constraints)
        return other

    def map(self, targets: ComplexArray, *, start: ComplexArray | None = None) -> PlaneMap:
        """The map that sends ``points`` to ``targets`` (c,).

        ``start`` (n,): a fold-free map for targets nearby, as between two frames; the literal
        methods always begin at F_b(0). Errors as for ``quasiconformal_map``.
        """
        plane, points = self._plane, self._constraints.points
        if targets.shape != points.shape or not np.isfinite(targets).all():
            raise EngineError("one finite target per control point", code="shape")
        if np.array_equal(targets, plane.z[points]):
            return self._finished(Descent(plane.z, (), 0, converged=True))
        if self._method in _LITERAL:
            return self._finished(
                self._literal.run(
                    targets,
                    equalise=self._method == "paper_teichmueller",
                    tolerance=self._tolerance,
                    most=self._most,
                )
            )
        return self._finished(self._extremal(self._smoothest(targets, start)))

    def _extremal(self, smooth: Descent) -> Descent:
        plane, constraints = self._plane, self._constraints
        if smooth.solves == 0 or self._method == "default":
            return smooth
        extreme = least_maximum if self._method == "minimal" else even_coefficient
        return extreme(plane, constraints, smooth, self._tolerance, self._most)

    def _smoothest(self, targets: ComplexArray, start: ComplexArray | None) -> Descent:
        plane, constraints = self._plane, self._constraints
        points = constraints.points
        refuse_impossible(plane, constraints, targets)
        if (len(points) == 1 and not constraints.sliding.any()) or constraints.fixed.all():
            moved = plane.z + (targets[0] - plane.z[points[0]])
            moved[points] = targets
            return Descent(moved, (), 0, converged=True)
        if start is not None and len(plane.folds(start)):
            raise QuasiconformalError("the start has folds", code="start_folded")
        attempt = self._staged.run(targets, start=start, tolerance=self._tolerance, most=self._most)
        left = plane.folds(attempt.descent.w)
        if attempt.reached and len(left) == 0:
            return attempt.descent
        near = points_near_folds(plane, points, attempt.descent.w)
        raise QuasiconformalError(
            f"{len(left)} faces stay folded after {attempt.descent.solves} solves; the targets"
            f" of {len(near)} control points near them contradict each other or go too far:"
            " drop some or move them less",
            code="not_reached",
            elements={"points": near.tolist(), "faces": left[:100].tolist()},
        )

    def _finished(self, descent: Descent) -> PlaneMap:
        plane = self._plane
        return PlaneMap(
            z=descent.w.copy(),
            mu=beltrami_coefficient(plane.z[plane.faces], plane.faces, descent.w),
            residuals=np.array(descent.residuals),
            solves=descent.solves,
            converged=descent.converged,
            folds=plane.folds(descent.w),
        )


def quasiconformal_map(
    domain: ComplexArray,
    faces: IntArray,
    points: IntArray,
    targets: ComplexArray,
    *,
    method: Method = "default",
    boundary: Boundary = "free",
    tolerance: float | None = None,
    start: ComplexArray | None = None,
    max_solves: int | None = None,
) -> PlaneMap:
    """Move vertices ``points`` (c,) of a plane mesh to ``targets`` (c,) with least distortion.

    ``domain`` (n,) with counter-clockwise ``faces`` (m, 3). ``points`` holds every constrained
    vertex, those of the boundary too. ``boundary`` says what the other boundary vertices do:
    ``"free"`` or, on the unit disk, ``"sliding"`` along the circle, in order. Targets that equal
    the domain give the domain, bit for bit.

    ``method="default"``: the map whose Beltrami coefficient varies least, with every point
    exactly where it was sent and no face turned over, or QuasiconformalError ``impossible``
    (certified before solving) or ``not_reached`` (within ``max_solves``, 200 by default) whose
    ``elements["points"]`` are indices into ``points``. ``tolerance``: max |Δμ| of the last step,
    1e-3 by default. ``start`` (n,): a fold-free map for targets nearby, as between two frames.

    ``method="minimal"``: in 120 solves at most, nearly the least possible max |μ|;
    ``"teichmueller"``: |μ| nearly the same everywhere, as on a Teichmüller map. Both go on from
    the default's map, without folds.

    ``method="paper"``: Algorithm 4, eqs. (8)-(12), tolerance 0.01, at most 300 solves;
    ``"paper_teichmueller"``: its form with |μ| set to its mean. Their folds are reported.
    """
    solver = QuasiconformalSolver(
        PreparedPlane(domain, faces),
        points,
        method=method,
        boundary=boundary,
        tolerance=tolerance,
        max_solves=max_solves,
    )
    return solver.map(targets, start=start)
