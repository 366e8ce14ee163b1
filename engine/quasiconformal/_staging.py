"""Predict, untangle, smooth; and for large moves the same in 2, 4, 8 stages."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from engine.distortion import DistortionDescent
from engine.quasiconformal._newton import Descent
from engine.quasiconformal._plane import Constraints, PreparedPlane
from engine.quasiconformal._smooth import CoefficientSmoother
from engine.types import BoolArray, ComplexArray

_STAGES = (1, 2, 4, 8)
_UNTANGLE_MOST = 40
_BETWEEN_MOST = 3  # smoothing steps at a stage that is only passed through


@dataclass(frozen=True, slots=True)
class Attempt:
    """Where it led; ``reached``: all points are in place and no triangle is turned."""

    descent: Descent
    reached: bool


class StagedDescent:
    """The default method on one plane under one set of constraints."""

    def __init__(self, plane: PreparedPlane, constraints: Constraints) -> None:
        self._plane = plane
        self._constraints = constraints
        self._smoother = CoefficientSmoother(plane, constraints)
        self._untangler: DistortionDescent | None = None
        self._on_boundary = plane.on_boundary[constraints.points]

    def run(
        self, targets: ComplexArray, *, start: ComplexArray | None, tolerance: float, most: int
    ) -> Attempt:
        """From ``start``, then from the identity in ever more stages, within ``most`` solves.

        When nothing reaches the targets: what the first attempt left there, with its folds.
        """
        plans = [(self._plane.z, stages) for stages in _STAGES]
        if start is not None:
            plans.insert(0, (start, 1))
        spent = 0
        attempts: list[Attempt] = []
        for begin, stages in plans:
            if attempts and spent >= most:
                break
            attempt = self._staged(begin, targets, stages, tolerance, most - spent)
            spent += attempt.descent.solves
            if attempt.reached:
                return Attempt(replace(attempt.descent, solves=spent), reached=True)
            attempts.append(attempt)
        return Attempt(replace(attempts[0].descent, solves=spent), reached=False)

    def _staged(
        self, begin: ComplexArray, targets: ComplexArray, stages: int, tolerance: float, most: int
    ) -> Attempt:
        w, spent = begin, 0
        origin = begin[self._constraints.points]
        for stage in range(1, stages):
            aim = stage_targets(origin, targets, stage / stages, self._on_boundary)
            passed = self._one(w, aim, tolerance, _BETWEEN_MOST, most - spent)
            w, spent = passed.descent.w, spent + passed.descent.solves
            if not passed.reached:
                return passed
        last = self._one(w, targets, tolerance, most, most - spent)
        return Attempt(replace(last.descent, solves=spent + last.descent.solves), last.reached)

    def _one(
        self, w: ComplexArray, targets: ComplexArray, tolerance: float, smoothing: int, most: int
    ) -> Attempt:
        w, spent = self._smoother.predict(w, targets), 1
        if self._plane.area_ratios(w).min() <= 0.0:
            allowed = min(_UNTANGLE_MOST, most - spent)
            found = self._descent().untangle(w, most=allowed, least_ratio=0.0, area=0.0)
            w, spent = found.w, spent + found.solves
            if not found.free:
                return Attempt(Descent(w, (), spent, converged=False), reached=False)
        smooth = self._smoother.descend(
            w, tolerance=tolerance, most=max(min(smoothing, most - spent), 1)
        )
        return Attempt(replace(smooth, solves=spent + smooth.solves), reached=True)

    def _descent(self) -> DistortionDescent:
        if self._untangler is None:
            plane, sliding = self._plane, self._constraints.sliding
            rim = plane.boundary_edges
            if not sliding.any():
                rim = rim[:0]
            self._untangler = DistortionDescent(plane.a, plane.faces, self._constraints.fixed, rim)
        return self._untangler


def stage_targets(
    origin: ComplexArray, targets: ComplexArray, share: float, on_boundary: BoolArray
) -> ComplexArray:
    """Where the points are at ``share`` of the way: twists follow arcs, the rest is straight.

    Boundary points and inner points each follow the logarithmic path of the similarity that fits
    them best; what it leaves over is added linearly.
    """
    way = np.empty_like(targets)
    for group in (on_boundary, ~on_boundary):
        p, q = origin[group], targets[group]
        if len(p) == 0:
            continue
        from_centre, to_centre = p - p.mean(), q - q.mean()
        square = float(np.vdot(from_centre, from_centre).real)
        turn = np.vdot(from_centre, to_centre) / square if square > 0.0 else 1.0 + 0j
        if abs(turn) < 1e-6:
            turn = 1.0 + 0j
        left = (to_centre - turn * from_centre) / turn
        drift = share * (q.mean() - p.mean())
        way[group] = np.exp(share * np.log(turn)) * (from_centre + share * left) + p.mean() + drift
    return way
