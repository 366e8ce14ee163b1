"""One damped Newton step and its line search, shared by smoothing and untangling."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from engine.errors import NumericalError
from engine.linalg import SymmetricPattern
from engine.quasiconformal._domain import PlaneDomain
from engine.types import ComplexArray, FloatArray

_FLOOR = 1e-10  # relative diagonal shift that absorbs rounding in a semi-definite Hessian
_SUFFICIENT = 1e-4  # Armijo
_HALVINGS = 30


@dataclass(frozen=True, slots=True)
class Direction:
    """A descent direction (n,), its slope (negative) and the factorisations it took."""

    step: ComplexArray
    slope: float
    solves: int


@dataclass(frozen=True, slots=True)
class Descent:
    """Where a descent arrived: ``residuals`` are max |Δμ| per step."""

    w: ComplexArray
    residuals: tuple[float, ...]
    solves: int
    converged: bool


def newton_direction(
    domain: PlaneDomain,
    pattern: SymmetricPattern,
    data: FloatArray,
    gradient: FloatArray,
    damping: float,
) -> Direction:
    """-H⁻¹g on the free vertices; H's diagonal is raised until it is positive definite."""
    g = gradient[domain.free].ravel()
    diagonal = data[pattern.diagonal]
    shift = damping + _FLOOR
    for solves in range(1, 9):
        data[pattern.diagonal] = diagonal * (1.0 + shift)
        factor = pattern.factor(data, definite=False)
        if factor.positive_definite:
            x = factor.solve(-g)
            step = np.zeros(len(domain.z), np.complex128)
            step[domain.free] = x[::2] + 1j * x[1::2]
            return Direction(step, float(g @ x), solves)
        shift = max(shift * 100.0, 1e-8)
    raise NumericalError("the plane's Hessian is not positive definite at any damping")


def backtrack(
    energy: Callable[[ComplexArray], float],
    w: ComplexArray,
    direction: Direction,
    longest: float,
) -> tuple[ComplexArray, float] | None:
    """The first of ``longest``, half of it, ... that decreases ``energy`` enough, or None."""
    before = energy(w)
    fraction = longest
    for _ in range(_HALVINGS):
        moved = w + fraction * direction.step
        if energy(moved) <= before + _SUFFICIENT * fraction * direction.slope:
            return moved, fraction
        fraction *= 0.5
    return None
