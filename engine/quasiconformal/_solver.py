"""The public way in: one domain with its control points, many targets, three methods."""

from __future__ import annotations

from typing import Literal

import numpy as np

from engine.beltrami import beltrami_coefficient
from engine.errors import EngineError, QuasiconformalError
from engine.quasiconformal._domain import PlaneDomain
from engine.quasiconformal._iteration import LiteralIteration
from engine.quasiconformal._limits import points_near_folds, refuse_impossible
from engine.quasiconformal._newton import Descent
from engine.quasiconformal._staging import StagedDescent
from engine.types import ComplexArray, IntArray, PlaneMap

Method = Literal["default", "paper", "teichmueller"]


class QuasiconformalSolver:
    """Maps of one plane mesh under one set of control points; analysed at the first, once.

    ``domain`` (n,) complex with counter-clockwise ``faces`` (m, 3); ``points`` (c,) distinct
    vertices that every call of ``map`` sends to its targets, those of the boundary among them
    if it is to be fixed. The options are those of ``quasiconformal_map``. Raises
    QuasiconformalError ``domain_folded`` if a face of the domain is turned over.
    """

    def __init__(
        self,
        domain: ComplexArray,
        faces: IntArray,
        points: IntArray,
        *,
        method: Method = "default",
        tolerance: float | None = None,
        max_solves: int | None = None,
    ) -> None:
        self._domain = PlaneDomain(
            np.ascontiguousarray(domain, np.complex128),
            np.ascontiguousarray(faces, np.int64),
            np.ascontiguousarray(points, np.int64),
        )
        self._method: Method = method
        literal = method != "default"
        usual_tolerance, usual_solves = (0.01, 300) if literal else (1e-3, 200)
        self._tolerance = usual_tolerance if tolerance is None else tolerance
        self._most = usual_solves if max_solves is None else max_solves
        self._staged: StagedDescent | None = None
        self._literal: LiteralIteration | None = None

    def map(self, targets: ComplexArray, *, start: ComplexArray | None = None) -> PlaneMap:
        """The map that sends ``points`` to ``targets`` (c,).

        ``start`` (n,): a fold-free map for targets nearby, as between two frames; the literal
        methods always begin at F_b(0). Errors as for ``quasiconformal_map``.
        """
        domain = self._domain
        if targets.shape != domain.points.shape or not np.isfinite(targets).all():
            raise EngineError("one finite target per control point", code="shape")
        if np.array_equal(targets, domain.z[domain.points]):
            return self._finished(Descent(domain.z, (), 0, converged=True))
        if self._method == "default":
            return self._finished(self._smoothest(targets, start))
        if self._literal is None:
            self._literal = LiteralIteration(domain)
        return self._finished(
            self._literal.run(
                targets,
                equalise=self._method == "teichmueller",
                tolerance=self._tolerance,
                most=self._most,
            )
        )

    def _smoothest(self, targets: ComplexArray, start: ComplexArray | None) -> Descent:
        domain = self._domain
        refuse_impossible(domain, targets)
        if len(targets) == 1 or len(domain.free) == 0:
            moved = domain.z + (targets[0] - domain.z[domain.points[0]])
            moved[domain.points] = targets
            return Descent(moved, (), 0, converged=True)
        if start is not None and len(domain.folds(start)):
            raise QuasiconformalError("the start has folds", code="start_folded")
        if self._staged is None:
            self._staged = StagedDescent(domain)
        attempt = self._staged.run(targets, start=start, tolerance=self._tolerance, most=self._most)
        left = domain.folds(attempt.descent.w)
        if attempt.reached and len(left) == 0:
            return attempt.descent
        near = points_near_folds(domain, attempt.descent.w)
        raise QuasiconformalError(
            f"{len(left)} faces stay folded after {attempt.descent.solves} solves; the targets"
            f" of {len(near)} control points near them contradict each other or go too far:"
            " drop some or move them less",
            code="not_reached",
            elements={"points": near.tolist(), "faces": left[:100].tolist()},
        )

    def _finished(self, descent: Descent) -> PlaneMap:
        domain = self._domain
        return PlaneMap(
            z=descent.w.copy(),
            mu=beltrami_coefficient(domain.z[domain.faces], domain.faces, descent.w),
            residuals=np.array(descent.residuals),
            solves=descent.solves,
            converged=descent.converged,
            folds=domain.folds(descent.w),
        )


def quasiconformal_map(
    domain: ComplexArray,
    faces: IntArray,
    points: IntArray,
    targets: ComplexArray,
    *,
    method: Method = "default",
    tolerance: float | None = None,
    start: ComplexArray | None = None,
    max_solves: int | None = None,
) -> PlaneMap:
    """Move vertices ``points`` (c,) of a plane mesh to ``targets`` (c,) with least distortion.

    ``points`` holds every constrained vertex, those of the boundary too; a boundary that is not
    constrained is free. Targets that equal the domain give the domain, bit for bit.

    ``method="default"``: the map whose Beltrami coefficient varies least, with every point
    exactly where it was sent and no face turned over, or QuasiconformalError ``impossible``
    (certified before solving) or ``not_reached`` (within ``max_solves``, 200 by default) whose
    ``elements["points"]`` are indices into ``points``. ``tolerance``: max |Δμ| of the last step,
    1e-3 by default. ``start`` (n,): a fold-free map for targets nearby, as between two frames.

    ``method="paper"``: Algorithm 4, eqs. (8)-(12), tolerance 0.01, at most 300 solves;
    ``"teichmueller"``: its form with |μ| set to its mean. Their folds are reported.
    """
    solver = QuasiconformalSolver(
        domain, faces, points, method=method, tolerance=tolerance, max_solves=max_solves
    )
    return solver.map(targets, start=start)
