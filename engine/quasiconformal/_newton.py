"""One damped Newton step and its line search, shared by smoothing and untangling."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from engine.errors import NumericalError
from engine.linalg import Factor, SymmetricPattern
from engine.quasiconformal._domain import PlaneDomain
from engine.types import ComplexArray, FloatArray

_FLOOR = 1e-10  # relative diagonal shift that absorbs rounding in a semi-definite Hessian
_SUFFICIENT = 1e-4  # Armijo
_ROUNDING = 1e-13  # relative, of a sum over all triangles
_HALVINGS = 30
_MOST_SHIFTS = 8
_MEMORY = 8


@dataclass(frozen=True, slots=True)
class Direction:
    """A descent direction (n,) and its slope, negative."""

    step: ComplexArray
    slope: float


@dataclass(frozen=True, slots=True)
class Descent:
    """Where a descent arrived: ``residuals`` are max |Δμ| per step."""

    w: ComplexArray
    residuals: tuple[float, ...]
    solves: int
    converged: bool


def damped_factor(pattern: SymmetricPattern, data: FloatArray, damping: float) -> Factor:
    """H's factor, its diagonal raised until it is positive definite."""
    diagonal = data[pattern.diagonal]
    shift = damping + _FLOOR
    for _ in range(_MOST_SHIFTS):
        data[pattern.diagonal] = diagonal * (1.0 + shift)
        factor = pattern.factor(data, definite=False)
        if factor.positive_definite:
            return factor
        shift = max(shift * 100.0, 1e-8)
    raise NumericalError("the plane's Hessian is not positive definite at any damping")


def newton_direction(domain: PlaneDomain, factor: Factor, gradient: FloatArray) -> Direction:
    """-H⁻¹g on the free vertices, 0 on the others; ``gradient`` (n, 2)."""
    g = gradient[domain.free].ravel()
    x = factor.solve(-g)
    return Direction(domain.spread(x), float(g @ x))


class SecantMemory:
    """Limited-memory BFGS (Nocedal 1980) on top of a factorisation in place of a scaling.

    Gauss-Newton leaves out the curvature of its residuals; the few slow directions that this
    costs are learnt from the steps themselves.
    """

    def __init__(self, domain: PlaneDomain) -> None:
        self._domain = domain
        self._pairs: deque[tuple[FloatArray, FloatArray, float]] = deque(maxlen=_MEMORY)
        self._last: tuple[FloatArray, FloatArray] | None = None

    def direction(self, factor: Factor, w: ComplexArray, gradient: FloatArray) -> Direction:
        """A descent direction at ``w``; remembers ``w`` and its gradient (n, 2)."""
        free = self._domain.free
        x, g = w[free].view(np.float64), gradient[free].ravel()
        if self._last is not None:
            s, y = x - self._last[0], g - self._last[1]
            if s @ y > 1e-10 * np.linalg.norm(s) * np.linalg.norm(y):
                self._pairs.append((s, y, float(s @ y)))
        self._last = (x, g)
        d = -g
        shares: list[float] = []
        for s, y, sy in reversed(self._pairs):
            shares.append(float(s @ d) / sy)
            d = d - shares[-1] * y
        d = factor.solve(d)
        for (s, y, sy), share in zip(self._pairs, reversed(shares), strict=True):
            d = d + (share - float(y @ d) / sy) * s
        return Direction(self._domain.spread(d), float(g @ d))


def backtrack(
    energy: Callable[[ComplexArray], float],
    w: ComplexArray,
    direction: Direction,
    longest: float,
) -> tuple[ComplexArray, float] | None:
    """The first of ``longest``, half of it, ... that decreases ``energy`` enough, or None."""
    allowed = energy(w) * (1.0 + _ROUNDING)
    fraction = longest
    for _ in range(_HALVINGS):
        moved = w + fraction * direction.step
        if energy(moved) <= allowed + _SUFFICIENT * fraction * direction.slope:
            return moved, fraction
        fraction *= 0.5
    return None
