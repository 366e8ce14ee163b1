"""Newton steps by preconditioned conjugate gradients, and their line search."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from engine.errors import NumericalError
from engine.linalg import Factor, SymmetricPattern
from engine.types import ComplexArray, FloatArray

_FLOOR = 1e-10  # relative diagonal shift that absorbs rounding in a semi-definite matrix
_SUFFICIENT = 1e-4  # Armijo
_ROUNDING = 1e-13  # relative, of a sum over all triangles
_HALVINGS = 30
_MOST_SHIFTS = 8

Vector = Callable[[ComplexArray], ComplexArray]


@dataclass(frozen=True, slots=True)
class Direction:
    """A displacement (n,), its slope (negative if it descends), and the products it took."""

    step: ComplexArray
    slope: float
    products: int


@dataclass(frozen=True, slots=True)
class Descent:
    """Where a descent arrived: ``residuals`` are max |Δμ| per step."""

    w: ComplexArray
    residuals: tuple[float, ...]
    solves: int
    converged: bool


def inner(x: ComplexArray, y: ComplexArray) -> float:
    """The real inner product of displacements."""
    return float(np.vdot(x, y).real)


def damped_factor(pattern: SymmetricPattern, data: FloatArray) -> Factor:
    """The factor of ``data`` with its diagonal raised until it is positive definite."""
    diagonal = data[pattern.diagonal]
    shift = _FLOOR
    for _ in range(_MOST_SHIFTS):
        data[pattern.diagonal] = diagonal * (1.0 + shift)
        with suppress(NumericalError):
            return pattern.factor(data)
        shift = max(shift * 100.0, 1e-8)
    raise NumericalError("the plane's Hessian is not positive definite at any damping")


def conjugate_gradients(
    product: Vector, precondition: Vector, right: ComplexArray, *, tolerance: float, most: int
) -> tuple[ComplexArray, int]:
    """x with H x ≈ ``right`` in the norm of the preconditioner, and the products it took.

    Stops at ``tolerance`` times the first residual, or where H curves down (Steihaug 1983): the
    iterate so far is a direction of descent, the first one if need be.
    """
    x = np.zeros_like(right)
    residual = right
    search = conditioned = precondition(residual)
    size = first = inner(residual, conditioned)
    for count in range(1, most + 1):
        if size <= 0.0:
            return x, count - 1
        image = product(search)
        curvature = inner(search, image)
        if curvature <= 1e-12 * size:
            return (search if count == 1 else x), count
        x = x + (size / curvature) * search
        residual = residual - (size / curvature) * image
        conditioned = precondition(residual)
        after = inner(residual, conditioned)
        if after <= tolerance**2 * first:
            return x, count
        search = conditioned + (after / size) * search
        size = after
    return x, most


def backtrack(
    energy: Callable[[ComplexArray], float],
    move: Callable[[float], ComplexArray],
    before: float,
    slope: float,
    longest: float,
) -> tuple[ComplexArray, float] | None:
    """The first of ``longest``, half of it, ... that decreases ``energy`` enough, or None."""
    allowed = before + _ROUNDING * abs(before)
    share = longest
    for _ in range(_HALVINGS):
        moved = move(share)
        if energy(moved) <= allowed + _SUFFICIENT * share * slope:
            return moved, share
        share *= 0.5
    return None
