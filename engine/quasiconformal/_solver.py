"""The public way in: one domain with its control points, many targets, three methods."""

from __future__ import annotations

from typing import Literal

import numpy as np

from engine.beltrami import beltrami_coefficient
from engine.errors import EngineError, QuasiconformalError
from engine.quasiconformal._domain import PlaneDomain
from engine.quasiconformal._iteration import LiteralIteration
from engine.quasiconformal._limits import points_near_folds, refuse_impossible
from engine.quasiconformal._staging import StagedDescent
from engine.types import ComplexArray, IntArray, PlaneMap

Method = Literal["default", "paper", "teichmueller"]


class QuasiconformalSolver:
    """Maps of one plane mesh under one set of control points, analysed once.

    ``domain`` (n,) complex with counter-clockwise ``faces`` (m, 3); ``points`` (c,) distinct
    vertices that every call of ``map`` sends to its targets, those of the boundary among them
    if it is to be fixed. Raises QuasiconformalError ``domain_folded`` if a face is turned over.
    """

    def __init__(self, domain: ComplexArray, faces: IntArray, points: IntArray) -> None:
        self._domain = PlaneDomain(
            np.ascontiguousarray(domain, np.complex128),
            np.ascontiguousarray(faces, np.int64),
            np.ascontiguousarray(points, np.int64),
        )
        self._staged: StagedDescent | None = None
        self._literal: LiteralIteration | None = None

    def map(
        self,
        targets: ComplexArray,
        *,
        method: Method = "default",
        tolerance: float | None = None,
        start: ComplexArray | None = None,
        max_solves: int | None = None,
    ) -> PlaneMap:
        """The map that sends ``points`` to ``targets`` (c,); see ``quasiconformal_map``."""
        if targets.shape != self._domain.points.shape or not np.isfinite(targets).all():
            raise EngineError("one finite target per control point", code="shape")
        if np.array_equal(targets, self._domain.z[self._domain.points]):
            return self._finished(self._domain.z, (), 0, converged=True)
        if method == "default":
            return self._default(
                targets,
                1e-3 if tolerance is None else tolerance,
                start,
                200 if max_solves is None else max_solves,
            )
        if self._literal is None:
            self._literal = LiteralIteration(self._domain)
        result = self._literal.run(
            targets,
            equalise=method == "teichmueller",
            tolerance=0.01 if tolerance is None else tolerance,
            most=300 if max_solves is None else max_solves,
        )
        return self._finished(result.w, result.residuals, result.solves, converged=result.converged)

    def _default(
        self, targets: ComplexArray, tolerance: float, start: ComplexArray | None, most: int
    ) -> PlaneMap:
        refuse_impossible(self._domain, targets)
        if len(targets) < 2:
            return self._finished(self._translated(targets), (), 0, converged=True)
        if self._staged is None:
            self._staged = StagedDescent(self._domain)
        if start is not None and len(self._domain.folds(start)):
            raise QuasiconformalError("the start has folds", code="start_folded")
        attempt = self._staged.run(targets, start=start, tolerance=tolerance, most=most)
        left = self._domain.folds(attempt.w)
        if attempt.reached and len(left) == 0:
            return self._finished(
                attempt.w, attempt.residuals, attempt.solves, converged=attempt.converged
            )
        near = points_near_folds(
            self._domain, attempt.w, self._domain.boundary()[self._domain.points]
        )
        raise QuasiconformalError(
            f"{len(left)} faces stay folded after {attempt.solves} solves; the targets of"
            f" {len(near)} control points near them contradict each other or go too far:"
            " drop some or move them less",
            code="not_reached",
            elements={"points": near.tolist(), "faces": left[:100].tolist()},
        )

    def _translated(self, targets: ComplexArray) -> ComplexArray:
        """One point fixes nothing but a translation."""
        moved = self._domain.z + (targets - self._domain.z[self._domain.points])
        moved[self._domain.points] = targets
        return moved

    def _finished(
        self, w: ComplexArray, residuals: tuple[float, ...], solves: int, *, converged: bool
    ) -> PlaneMap:
        domain = self._domain
        return PlaneMap(
            z=w.copy(),
            mu=beltrami_coefficient(domain.z[domain.faces], domain.faces, w),
            residuals=np.array(residuals),
            solves=solves,
            converged=converged,
            folds=domain.folds(w),
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
    return QuasiconformalSolver(domain, faces, points).map(
        targets, method=method, tolerance=tolerance, start=start, max_solves=max_solves
    )
