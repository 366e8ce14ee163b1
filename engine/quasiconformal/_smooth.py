"""P and H: Newton's method for the map whose Beltrami coefficient varies least.

Minimises Σ_e w_e |μᵢ - μⱼ|² over interior edges plus a barrier Σ_t W_t (1 + |μ|²)/(1 - |μ|²),
under hard constraints. That is the smooth fixed point which Algorithm 4 of the paper looks for.
μ is holomorphic in the vertex positions, so the Gauss-Newton matrix is Hermitian in the complex
positions and, like the bilaplacian that it approximates, nearly real: a factorisation of its real
part, with one unknown per vertex, preconditions the exact Hessian so well that conjugate
gradients need a handful of products, however fine the mesh.

The barrier weighs half by area and half by count: by area alone a triangle of 1e-9 of the disk
would have none.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine.linalg import Factor
from engine.quasiconformal._newton import (
    Descent,
    Direction,
    backtrack,
    conjugate_gradients,
    damped_factor,
    inner,
)
from engine.quasiconformal._plane import Constraints, PreparedPlane
from engine.quasiconformal._smooth_kernels import (
    assemble_preconditioner,
    coefficient_and_slopes,
    face_slopes,
    first_fold,
    forces,
    hessian_product,
    pulled_back,
    total_energy,
)
from engine.types import ComplexArray, FloatArray

_BARRIER = 0.01
_SAFE_FRACTION = 0.9  # of the step at which the first triangle would turn over
_FORCING = 0.02  # relative residual of a Newton system
_PREDICTING = 1e-3
_MOST_PRODUCTS = 60
_STALE = 12  # products after which a kept factorisation is renewed


@dataclass(frozen=True, slots=True)
class _Linearised:
    """The energy's derivatives at one map ``w``."""

    w: ComplexArray
    mu: ComplexArray
    slopes: ComplexArray
    inverse: ComplexArray
    force: ComplexArray
    gradient: ComplexArray
    face_slope: FloatArray
    face_curve: FloatArray


@dataclass(frozen=True, slots=True)
class Objective:
    """Σ ``hinge`` |μᵢ - μⱼ|² + Σ ``face`` m^power + Σ ``pull`` (|μ|² - level)² / (4 level).

    m = (1 + |μ|²) / (1 - |μ|²); ``hinge`` (e,), ``face`` and ``pull`` (m,).
    """

    hinge: FloatArray
    face: FloatArray
    pull: FloatArray
    power: float = 1.0
    level: float = 1.0

    @classmethod
    def smooth(cls, plane: PreparedPlane) -> Objective:
        """The default: the least variation of μ, with a barrier."""
        share = 0.5 * (plane.area / plane.area.sum() + 1.0 / len(plane.faces))
        return cls(plane.hinges.weight, _BARRIER * share, np.zeros(len(share)))


class CoefficientSmoother:
    """P and H on one plane under one set of constraints."""

    def __init__(
        self, plane: PreparedPlane, constraints: Constraints, objective: Objective | None = None
    ) -> None:
        self._plane = plane
        self._constraints = constraints
        self._objective = objective or Objective.smooth(plane)
        self._factor: Factor | None = None

    def coefficient(self, w: ComplexArray) -> ComplexArray:
        """μ (m,) of the map plane -> ``w``."""
        a = self._plane.a
        return coefficient_and_slopes(
            a, self._plane.faces, w, np.empty_like(a), np.empty(len(a), np.complex128)
        )

    def predict(self, w: ComplexArray, targets: ComplexArray) -> ComplexArray:
        """P: ``w`` with its constrained vertices at ``targets``, to first order. One solve.

        The result may have folds.
        """
        points = self._constraints.points
        shift = np.zeros_like(w)
        shift[points] = targets - w[points]
        at = self._linearised(w)
        self._factor = self._factorised(at)
        found = self._direction(at, shift, _PREDICTING)
        moved = self._constraints.moved(w, shift + found.step, 1.0)
        moved[points] = targets
        return moved

    def descend(self, w: ComplexArray, *, tolerance: float, most: int) -> Descent:
        """H: from a fold-free ``w`` to max |Δμ| < ``tolerance`` in at most ``most`` solves."""
        plane = self._plane
        residuals: list[float] = []
        converged, stale = False, True
        nothing = np.zeros_like(w)
        before = self._energy(w)
        while len(residuals) < most and not converged:
            at = self._linearised(w)
            fresh = stale or self._factor is None
            if fresh:
                self._factor = self._factorised(at)
            found = self._direction(at, nothing, _FORCING)
            limit = first_fold(plane.a, plane.faces, w, found.step)
            reached = self._searched(w, found, before, min(1.0, _SAFE_FRACTION * limit))
            if reached is None and not fresh:
                stale = True
                continue
            if reached is None:
                break
            w, share = reached
            before = self._energy(w)
            residuals.append(float(np.abs(self.coefficient(w) - at.mu).max()))
            converged = residuals[-1] < tolerance and share > 0.5
            stale = found.products > _STALE
        return Descent(w, tuple(residuals), len(residuals), converged)

    def _searched(
        self, w: ComplexArray, found: Direction, before: float, longest: float
    ) -> tuple[ComplexArray, float] | None:
        def move(share: float) -> ComplexArray:
            return self._constraints.moved(w, found.step, share)

        return backtrack(self._energy, move, before, found.slope, longest)

    def _energy(self, w: ComplexArray) -> float:
        plane, hinges, aim = self._plane, self._plane.hinges, self._objective
        return total_energy(
            plane.a,
            plane.faces,
            w,
            hinges.first,
            hinges.second,
            aim.hinge,
            aim.face,
            aim.power,
            aim.level,
            aim.pull,
        )

    def _linearised(self, w: ComplexArray) -> _Linearised:
        plane, hinges, aim = self._plane, self._plane.hinges, self._objective
        slopes = np.empty_like(plane.a)
        inverse = np.empty(len(plane.faces), np.complex128)
        mu = coefficient_and_slopes(plane.a, plane.faces, w, slopes, inverse)
        slope, curve = face_slopes(mu, aim.face, aim.power, aim.level, aim.pull)
        force = forces(mu, hinges.first, hinges.second, aim.hinge, slope)
        gradient = pulled_back(plane.faces, slopes, force, len(w))
        return _Linearised(w, mu, slopes, inverse, force, gradient, slope, curve)

    def _factorised(self, at: _Linearised) -> Factor:
        """Of the real part of the Gauss-Newton matrix, the faces' curvature at its mean."""
        plane, hinges = self._plane, self._plane.hinges
        data = np.empty(plane.elements.nnz)
        mean = 2.0 * (np.maximum(at.face_slope, 0.0) + at.face_curve * np.abs(at.mu) ** 2)
        assemble_preconditioner(
            at.slopes,
            hinges.first,
            hinges.second,
            self._objective.hinge,
            mean,
            hinges.count,
            plane.elements.position,
            data,
        )
        data[self._constraints.dropped] = 0.0
        data[plane.analysis.diagonal[self._constraints.points]] = 1.0
        return damped_factor(plane.analysis, data)

    def _direction(self, at: _Linearised, shift: ComplexArray, tolerance: float) -> Direction:
        """The Newton step of the allowed vertices when the others move by ``shift`` (n,)."""
        factor, constraints = self._factor, self._constraints
        assert factor is not None
        circle = np.where(constraints.sliding, -(at.gradient.conjugate() * at.w).real, 0.0)

        def product(d: ComplexArray) -> ComplexArray:
            return constraints.allowed(at.w, self._product(at, d) + circle * d)

        def precondition(r: ComplexArray) -> ComplexArray:
            return constraints.allowed(at.w, factor.solve(r))

        pull = at.gradient + self._product(at, shift) if shift.any() else at.gradient
        right = constraints.allowed(at.w, -pull)
        step, products = conjugate_gradients(
            product, precondition, right, tolerance=tolerance, most=_MOST_PRODUCTS
        )
        return Direction(step, -inner(right, step), products)

    def _product(self, at: _Linearised, d: ComplexArray) -> ComplexArray:
        plane, hinges = self._plane, self._plane.hinges
        return hessian_product(
            plane.a,
            plane.faces,
            at.mu,
            at.slopes,
            at.inverse,
            at.force,
            hinges.first,
            hinges.second,
            self._objective.hinge,
            at.face_slope,
            at.face_curve,
            d,
        )
