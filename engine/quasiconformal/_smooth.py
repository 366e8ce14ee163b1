"""P and H: Newton's method for the map whose Beltrami coefficient varies least.

Minimises, under hard constraints, the variation Σ_e w_e |μᵢ - μⱼ|² over interior edges, which is
what Algorithm 4 of the paper smooths; plus a little Σ_t A_t √(|μ|² + δ²), which lets skin rest
where nothing moves; plus a barrier Σ_t W_t ((1 + |μ|²) / (1 - |μ|²))⁶ against folds.

μ is holomorphic in the vertex positions, so the Gauss-Newton matrix is Hermitian in the complex
positions and, like the bilaplacian that it approximates, nearly real: a factorisation of its real
part, with one unknown per vertex, preconditions the exact Hessian so well that conjugate
gradients need a handful of products, however fine the mesh.

The barrier weighs partly by count: by area alone a triangle of 1e-9 of the disk would have none.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from engine._distortion_kernels import first_fold
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
    entries_touching,
    face_slopes,
    forces,
    hessian_product,
    pulled_back,
    total_energy,
)
from engine.types import BoolArray, ComplexArray, FloatArray

_BARRIER, _BARRIER_POWER = 1e-5, 6.0
_SPARSITY, _STILL = 0.004, 0.03  # weight of |μ| by area; |μ| below which it counts as 0
_SAFE_FRACTION = 0.9  # of the step at which the first triangle would turn over
_FORCING = 0.02  # relative residual of a Newton system
_MOST_HALVINGS = 8  # of a prediction, as vertices that slide along arcs may need
_SAFE_SHARE = 0.5  # of the same, for a prediction
_PREDICTING = 1e-3
_MOST_PRODUCTS = 60
_MOST_OF_ENERGY = 0.98
_LEAST_STIFFNESS = 1e-12  # of the stiffest face, for the preconditioner
_FAR = 0.98  # of the energy left after a step, below which a minimum is still far
_NEARBY = 0.1  # max |Δμ| up to which a factorisation serves other maps
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
    """Σ ``hinge`` |μᵢ - μⱼ|² + Σ ``face`` m^power + Σ ``still`` √(|μ|² + δ²) + Σ ``pull`` e(|μ|²).

    m = (1 + |μ|²) / (1 - |μ|²), e(s) = (s - level)² / (4 level); ``hinge`` (e,), the others (m,).
    ``gauss``: leave the second derivatives of μ out of the Hessian, far from a minimum.
    """

    hinge: FloatArray
    face: FloatArray
    still: FloatArray
    pull: FloatArray
    power: float = _BARRIER_POWER
    level: float = 1.0
    gauss: bool = False

    @classmethod
    def smooth(cls, plane: PreparedPlane) -> Objective:
        """The default's."""
        count = len(plane.faces)
        by_area = plane.area / plane.area.sum()
        mixed = 0.75 * by_area + 0.25 / count
        return cls(plane.hinges.weight, _BARRIER * mixed, _SPARSITY * by_area, np.zeros(count))

    def where(self, moving: BoolArray) -> Objective:
        """Without the terms of faces that cannot move: they are constant, and may be huge."""
        return replace(
            self, face=self.face * moving, still=self.still * moving, pull=self.pull * moving
        )


class CoefficientSmoother:
    """P and H on one plane under one set of constraints."""

    def __init__(
        self, plane: PreparedPlane, constraints: Constraints, objective: Objective | None = None
    ) -> None:
        self._plane = plane
        self._constraints = constraints
        movable = ~constraints.fixed[plane.faces]
        self._moving = movable[:, 0] | movable[:, 1] | movable[:, 2]
        self._objective = (objective or Objective.smooth(plane)).where(self._moving)
        pattern = plane.elements
        self._dropped = entries_touching(constraints.fixed, pattern.indptr, pattern.indices)
        self._kept: tuple[Factor, ComplexArray] | None = None

    def coefficient(self, w: ComplexArray) -> ComplexArray:
        """μ (m,) of the map plane -> ``w``."""
        a = self._plane.a
        return coefficient_and_slopes(
            a, self._plane.faces, w, np.empty_like(a), np.empty(len(a), np.complex128)
        )

    def largest(self, w: ComplexArray) -> float:
        """max |μ| over the triangles that can move."""
        return float(np.abs(self.coefficient(w)[self._moving]).max(initial=0.0))

    def predict(self, w: ComplexArray, targets: ComplexArray) -> tuple[ComplexArray, float]:
        """P: the map that ``w`` becomes, to first order, as its points go to ``targets``.

        One solve. Also returns the share of the way that was gone, 1 unless triangles would turn
        over before.
        """
        step = self._response(w, targets)
        plane, constraints = self._plane, self._constraints
        limit = first_fold(plane.a, plane.faces, w, step)
        share = 1.0 if limit > 1.0 else _SAFE_SHARE * limit
        for _ in range(_MOST_HALVINGS):
            moved = constraints.moved(w, step, share)
            if share == 1.0:
                moved[constraints.points] = targets
            if plane.area_ratios(moved).min() > 0.0:
                return moved, share
            share *= 0.5
        return w, 0.0

    def thrown(self, w: ComplexArray, targets: ComplexArray) -> ComplexArray:
        """P all the way: every point is in place, and triangles may be turned over."""
        moved = self._constraints.moved(w, self._response(w, targets), 1.0)
        moved[self._constraints.points] = targets
        return moved

    def _response(self, w: ComplexArray, targets: ComplexArray) -> ComplexArray:
        points = self._constraints.points
        shift = np.zeros_like(w)
        shift[points] = targets - w[points]
        at = self._linearised(w, exact=False)
        self._refactor(at, anew=False)
        return shift + self._direction(at, shift, _PREDICTING).step

    def descend(self, w: ComplexArray, *, tolerance: float, most: int) -> Descent:
        """H: from a fold-free ``w`` to max |Δμ| < ``tolerance`` in at most ``most`` solves."""
        plane = self._plane
        residuals: list[float] = []
        converged, stale, exact = False, False, not self._objective.gauss
        nothing = np.zeros_like(w)
        before = self._energy(w)
        while len(residuals) < most and not converged:
            at = self._linearised(w, exact=exact)
            fresh = self._refactor(at, anew=stale)
            found = self._direction(at, nothing, _FORCING)
            limit = first_fold(plane.a, plane.faces, w, found.step)
            longest = min(self._full_step(found, before), _SAFE_FRACTION * limit)
            reached = self._searched(w, found, before, longest)
            if reached is None and not fresh:
                stale = True
                continue
            if reached is None:
                break
            w, share = reached
            last, before = before, self._energy(w)
            exact = not self._objective.gauss and before > _FAR * last
            residuals.append(float(np.abs(self.coefficient(w) - at.mu).max()))
            converged = residuals[-1] < tolerance and share > 0.5
            stale = found.products > _STALE
        return Descent(w, tuple(residuals), len(residuals), converged)

    def _full_step(self, found: Direction, energy: float) -> float:
        """1, or for a high p-norm the share of the step that is Newton's on the energy's logarithm.

        On Σ m^p itself a step gains a factor e at most, however large p is.
        """
        if not self._objective.gauss:
            return 1.0
        return 1.0 / (1.0 - min(-found.slope / energy, _MOST_OF_ENERGY))

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
            aim.still,
            aim.pull,
            aim.power,
            _STILL,
            aim.level,
        )

    def _linearised(self, w: ComplexArray, *, exact: bool) -> _Linearised:
        """``exact``: with the second derivatives of μ, which help near a minimum only."""
        plane, hinges, aim = self._plane, self._plane.hinges, self._objective
        slopes = np.empty_like(plane.a)
        inverse = np.empty(len(plane.faces), np.complex128)
        mu = coefficient_and_slopes(plane.a, plane.faces, w, slopes, inverse)
        slope, curve = face_slopes(mu, aim.face, aim.still, aim.pull, aim.power, _STILL, aim.level)
        force = forces(mu, hinges.first, hinges.second, aim.hinge, slope)
        gradient = pulled_back(plane.faces, slopes, force, len(w))
        if not exact:
            force = np.zeros_like(force)
        return _Linearised(w, mu, slopes, inverse, force, gradient, slope, curve)

    def _refactor(self, at: _Linearised, *, anew: bool) -> bool:
        """Whether the factorisation that is kept was renewed: ``anew``, or since it is far off."""
        near = self._kept is not None and np.abs(at.mu - self._kept[1]).max() < _NEARBY
        if anew or not near:
            self._kept = self._factorised(at), at.mu
            return True
        return False

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
            np.maximum(mean, _LEAST_STIFFNESS * mean.max()),
            hinges.count,
            plane.elements.position,
            data,
        )
        data[self._dropped] = 0.0
        data[plane.analysis.diagonal[self._constraints.points]] = 1.0
        return damped_factor(plane.analysis, data)

    def _direction(self, at: _Linearised, shift: ComplexArray, tolerance: float) -> Direction:
        """The Newton step of the allowed vertices when the others move by ``shift`` (n,)."""
        assert self._kept is not None
        factor, constraints = self._kept[0], self._constraints
        circle = np.where(constraints.sliding, -(at.gradient.conjugate() * at.w).real, 0.0)

        def product(d: ComplexArray) -> ComplexArray:
            return constraints.allowed(at.w, self._product(at, d) + circle * d)

        def precondition(r: ComplexArray) -> ComplexArray:
            return constraints.allowed(at.w, factor.solve(r))

        pull = self._product(at, shift) if shift.any() else at.gradient
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
