"""P and H: Gauss-Newton for the map whose Beltrami coefficient varies least.

Minimises Σ_e w_e |μᵢ - μⱼ|² over interior edges plus a barrier Σ_t W_t (1 + |μ|²)/(1 - |μ|²),
under hard constraints. That is the smooth fixed point which Algorithm 4 of the paper looks for;
μ is holomorphic in the vertex positions, so its Gauss-Newton steps are cheap and few.

w_e = |edge| / |dual edge| does not depend on scale. The barrier weighs half by area and half by
count: by area alone a triangle of 1e-9 of the disk would have none.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine.linalg import ElementPattern, Factor
from engine.quasiconformal._domain import PlaneDomain
from engine.quasiconformal._newton import (
    Descent,
    SecantMemory,
    backtrack,
    damped_factor,
    newton_direction,
)
from engine.quasiconformal._smooth_kernels import (
    assemble_hinges,
    coefficient_and_slopes,
    first_fold,
    smoothness,
)
from engine.types import BoolArray, ComplexArray, FloatArray, IntArray

_TOTAL_EDGE_WEIGHT = 1.5
_BARRIER = 0.01
_SAFE_FRACTION = 0.9  # of the step at which the first triangle would turn over
_FAST = 0.5  # contraction of |Δμ| at which a factorisation serves another step
_NEAR = 0.1  # stands for the |Δμ| before the first step


@dataclass(frozen=True, slots=True)
class Hinges:
    """Pairs of triangles with a common edge; see ``assemble_hinges`` for the arrays.

    The one triangle of a mesh of one is paired with itself.
    """

    pairs: IntArray
    corners: IntArray
    local: IntArray
    carries: BoolArray
    weight: FloatArray


def find_hinges(z: ComplexArray, faces: IntArray) -> Hinges:
    """All hinges of an oriented manifold mesh with plane positions ``z``."""
    side = np.arange(faces.size)
    tail, head = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    low, high = np.minimum(tail, head), np.maximum(tail, head)
    order = np.lexsort((high, low))
    same = (low[order][1:] == low[order][:-1]) & (high[order][1:] == high[order][:-1])
    first, second = side[order][:-1][same], side[order][1:][same]
    if len(first) == 0:
        first = second = np.zeros(1, np.int64)
    pairs = np.stack([first // 3, second // 3], axis=1)
    corner = first % 3
    local = np.empty((len(pairs), 2, 3), np.int64)
    corners = np.empty((len(pairs), 4), np.int64)
    rows = np.arange(len(pairs))
    for k in range(3):
        local[rows, 0, (corner + k) % 3] = k
        corners[:, k] = faces[pairs[:, 0], (corner + k) % 3]
    start = second % 3
    local[rows, 1, start] = 1
    local[rows, 1, (start + 1) % 3] = 0
    local[rows, 1, (start + 2) % 3] = 3
    corners[:, 3] = faces[pairs[:, 1], (start + 2) % 3]
    alone = pairs[:, 0] == pairs[:, 1]
    local[alone, 1] = local[alone, 0]
    _, carrier = np.unique(pairs.ravel(), return_index=True)
    carries = np.zeros(pairs.size, np.bool_)
    carries[carrier] = True
    centre = z[faces].mean(axis=1)
    dual = np.abs(centre[pairs[:, 0]] - centre[pairs[:, 1]])
    length = np.abs(z[corners[:, 1]] - z[corners[:, 0]])
    weight = length / np.where(dual > 0.0, dual, np.inf)
    total = float(weight.sum())
    weight *= _TOTAL_EDGE_WEIGHT / total if total > 0.0 else 0.0
    return Hinges(pairs, corners, local, carries.reshape(-1, 2), weight)


class CoefficientSmoother:
    """P and H on one domain with fixed constrained vertices; analysed once."""

    def __init__(self, domain: PlaneDomain) -> None:
        self._domain = domain
        self._hinges = find_hinges(domain.z, domain.faces)
        unknown = domain.unknown.reshape(-1, 2)[self._hinges.corners]
        self._elements = ElementPattern(unknown.reshape(-1, 8), domain.unknowns)
        self._pattern = self._elements.analyse()
        share = 0.5 * (domain.area / domain.area.sum() + 1.0 / len(domain.faces))
        self._barrier = _BARRIER * share
        self._identity: Factor | None = None

    def _assemble(
        self, w: ComplexArray, shift: ComplexArray | None
    ) -> tuple[FloatArray, FloatArray, ComplexArray]:
        domain, hinges = self._domain, self._hinges
        slopes = np.empty_like(domain.a)
        mu = coefficient_and_slopes(domain.a, domain.faces, w, slopes)
        data = np.empty(self._elements.nnz)
        gradient = np.empty((len(domain.z), 2))
        assemble_hinges(
            domain.a,
            domain.faces,
            w,
            mu,
            slopes,
            hinges.pairs,
            hinges.corners,
            hinges.local,
            hinges.carries,
            hinges.weight,
            self._barrier,
            np.zeros_like(domain.z) if shift is None else shift,
            self._elements.position,
            data,
            gradient,
        )
        return data, gradient, mu

    def _energy(self, w: ComplexArray) -> float:
        mu = self.coefficient(w)
        return smoothness(mu, self._hinges.pairs, self._hinges.weight, self._barrier)

    def coefficient(self, w: ComplexArray) -> ComplexArray:
        """μ (m,) of the map domain -> ``w``."""
        domain = self._domain
        return coefficient_and_slopes(domain.a, domain.faces, w, np.empty_like(domain.a))

    def predict(self, w: ComplexArray, targets: ComplexArray) -> ComplexArray:
        """P: ``w`` with its constrained vertices at ``targets``, to first order. One solve.

        From the identity the factorisation is kept. The result may have folds.
        """
        domain = self._domain
        shift = np.zeros_like(domain.z)
        shift[domain.points] = targets - w[domain.points]
        data, gradient, _ = self._assemble(w, shift)
        factor = self._identity
        if factor is None or w is not domain.z:
            factor = damped_factor(self._pattern, data, 0.0)
        if w is domain.z:
            self._identity = factor
        moved = w + newton_direction(domain, factor, gradient).step
        moved[domain.points] = targets
        return moved

    def descend(self, w: ComplexArray, *, tolerance: float, most: int) -> Descent:
        """H: from a fold-free ``w`` to max |Δμ| < ``tolerance`` in at most ``most`` solves.

        Gauss-Newton alone converges linearly, so a factorisation is kept while |Δμ| falls fast,
        and secants of the steps taken add the curvature that it leaves out.
        """
        domain = self._domain
        residuals = [_NEAR]
        factor: Factor | None = None
        damping, converged = 0.0, False
        memory = SecantMemory(domain)
        while len(residuals) <= most and not converged:
            data, gradient, mu = self._assemble(w, None)
            kept = factor is not None
            if factor is None:
                factor = damped_factor(self._pattern, data, damping)
            direction = memory.direction(factor, w, gradient)
            limit = first_fold(domain.a, domain.faces, w, direction.step)
            longest = min(1.0, _SAFE_FRACTION * limit)
            found = backtrack(self._energy, w, direction, longest)
            if found is None and kept:
                factor = None
                continue
            if found is None:
                break
            w, fraction = found
            damping = _next_damping(damping, fraction)
            residuals.append(float(np.abs(self.coefficient(w) - mu).max()))
            converged = residuals[-1] < tolerance and fraction > 0.5
            if fraction < 1.0 or residuals[-1] > _FAST * residuals[-2]:
                factor = None
        return Descent(w, tuple(residuals[1:]), len(residuals) - 1, converged)


def _next_damping(damping: float, fraction: float) -> float:
    """Levenberg's: less after a long step, none when it is small, more after a short one."""
    if fraction <= 0.5:
        return max(3.0 * damping, 1e-3)
    return 0.3 * damping if damping > 3e-5 else 0.0
