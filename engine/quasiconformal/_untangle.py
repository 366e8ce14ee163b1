"""U: from a map with folds to one without (Garanzha et al., Foldover-free maps in 50 lines, 2021).

Projected Newton on Σ_t ((P + Q)/χ(D))^k with a softening ε that shrinks as the energy allows
and is 0 once no triangle is turned. Every triangle weighs the same: small ones fold first.
"""

from __future__ import annotations

import numpy as np

from engine.linalg import ElementPattern
from engine.quasiconformal._domain import PlaneDomain
from engine.quasiconformal._mips_kernels import assemble_untangling, untangling_energy
from engine.quasiconformal._newton import Descent, backtrack, damped_factor, newton_direction
from engine.types import ComplexArray

_LEAST_START = 0.02  # of ε, as an area ratio
_FOLD_SHARE = 0.2  # of the worst area ratio, at the start
_LEAST_GAIN = 0.1  # of the energy, that ε's decrease assumes


class Untangler:
    """U on one domain with fixed constrained vertices; analysed once."""

    def __init__(self, domain: PlaneDomain) -> None:
        self._domain = domain
        unknown = domain.unknown.reshape(-1, 2)[domain.faces]
        self._elements = ElementPattern(unknown.reshape(-1, 6), domain.unknowns)
        self._pattern = self._elements.analyse()
        self._weight = np.full(len(domain.faces), 1.0 / len(domain.faces))

    def descend(self, w: ComplexArray, *, most: int, power: float = 1.0) -> Descent:
        """Until no triangle is turned (``converged``) or ``most`` solves are spent."""
        domain = self._domain
        ratio = float(domain.area_ratios(w).min())
        epsilon = max(_FOLD_SHARE * abs(ratio), _LEAST_START)
        data = np.empty(self._elements.nnz)
        gradient = np.empty((len(domain.z), 2))
        solves = 0
        while ratio <= 0.0 and solves < most:

            def energy(at: ComplexArray, epsilon: float = epsilon) -> float:
                return untangling_energy(domain.a, domain.faces, at, self._weight, epsilon, power)

            assemble_untangling(
                domain.a,
                domain.faces,
                w,
                self._weight,
                epsilon,
                power,
                self._elements.position,
                data,
                gradient,
            )
            factor = damped_factor(self._pattern, data, 0.0)
            direction = newton_direction(domain, factor, gradient)
            solves += 1
            before = energy(w)
            found = backtrack(energy, w, direction, 1.0)
            if found is None:
                break
            w = found[0]
            ratio = float(domain.area_ratios(w).min())
            epsilon = _lowered(epsilon, ratio, 1.0 - energy(w) / before)
        return Descent(w, (), solves, ratio > 0.0)


def _lowered(epsilon: float, ratio: float, gain: float) -> float:
    """The next ε, from the smallest area ratio and the relative decrease of the energy."""
    chi = 0.5 * (ratio + np.hypot(ratio, epsilon))
    reached = (1.0 - max(_LEAST_GAIN, gain)) * chi
    if ratio >= reached:
        return 1e-10
    return float(2.0 * np.sqrt(reached * (reached - ratio)))
