"""Follow the control points to their targets, smoothing on the way; or untangle what is left."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine.distortion import DistortionDescent
from engine.quasiconformal._newton import Descent
from engine.quasiconformal._plane import Constraints, PreparedPlane
from engine.quasiconformal._smooth import CoefficientSmoother
from engine.types import BoolArray, ComplexArray

_UNTANGLE_MOST = 40
_BETWEEN, _BETWEEN_MOST = 0.05, 4  # tolerance and solves at a place that is only passed through
_STUCK_MOST = 10  # solves where the way seems blocked
_MOST_STUCK = 6  # steps in a row
_SHORTEST = 1 / 128  # of the way, for one step
_LONGER = 1.5


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
        self._on_boundary = plane.on_boundary[constraints.points]

    def run(
        self, targets: ComplexArray, *, start: ComplexArray | None, tolerance: float, most: int
    ) -> Attempt:
        """From ``start``, else from the identity, else untangled at the targets themselves.

        Within ``most`` solves. When nothing reaches the targets: what untangling left there, with
        its folds.
        """
        spent = 0
        begins = [self._plane.z] if start is None else [start, self._plane.z]
        for begin in begins:
            attempt = self._followed(begin, targets, tolerance, most - spent)
            spent += attempt.descent.solves
            if attempt.reached:
                return Attempt(_counted(attempt.descent, spent), reached=True)
        attempt = self._untangled(targets, tolerance, max(most - spent, 1))
        return Attempt(_counted(attempt.descent, spent + attempt.descent.solves), attempt.reached)

    def _followed(
        self, begin: ComplexArray, targets: ComplexArray, tolerance: float, most: int
    ) -> Attempt:
        """Predict the whole way or as far as no triangle turns, smooth, and go on from there."""
        w, spent, gone, ahead, stuck = begin, 0, 0.0, 1.0, 0
        origin = begin[self._constraints.points]
        if np.array_equal(origin, targets):
            return Attempt(self._smoother.descend(w, tolerance=tolerance, most=most), reached=True)
        while spent < most:
            to = min(gone + ahead, 1.0)
            aim = targets if to == 1.0 else stage_targets(origin, targets, to, self._on_boundary)
            w, share = self._smoother.predict(w, aim)
            spent += 1
            gone += share * (to - gone)
            if gone == 1.0:
                last = self._smoother.descend(w, tolerance=tolerance, most=max(most - spent, 1))
                return Attempt(_counted(last, spent + last.solves), reached=True)
            short = share * ahead < _SHORTEST
            stuck = stuck + 1 if short else 0
            if stuck > _MOST_STUCK:
                break
            between = min(_STUCK_MOST if short else _BETWEEN_MOST, max(most - spent, 1))
            passed = self._smoother.descend(w, tolerance=_BETWEEN, most=between)
            w, spent = passed.w, spent + passed.solves
            ahead = max(_LONGER * (ahead if share == 1.0 else share * ahead), _SHORTEST)
        return Attempt(Descent(w, (), spent, converged=False), reached=False)

    def _untangled(self, targets: ComplexArray, tolerance: float, most: int) -> Attempt:
        """Put the points where they must go at once, undo the folds that this makes, smooth."""
        w = self._smoother.thrown(self._plane.z, targets)
        found = self._descent().untangle(
            w, most=min(_UNTANGLE_MOST, most), least_ratio=0.0, area=0.1
        )
        if not found.free:
            return Attempt(Descent(found.w, (), found.solves + 1, converged=False), reached=False)
        left = max(most - found.solves - 1, 1)
        last = self._smoother.descend(found.w, tolerance=tolerance, most=left)
        return Attempt(_counted(last, found.solves + 1 + last.solves), reached=True)

    def _descent(self) -> DistortionDescent:
        plane, constraints = self._plane, self._constraints
        edges = plane.boundary_edges
        on_circle = (constraints.sliding | constraints.fixed)[edges].all(axis=1)
        rim = edges[on_circle & constraints.sliding[edges].any(axis=1)]
        return DistortionDescent(plane.a, plane.faces, constraints.fixed, rim)


def _counted(descent: Descent, solves: int) -> Descent:
    return Descent(descent.w, descent.residuals, solves, descent.converged)


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
