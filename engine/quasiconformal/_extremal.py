"""Extremal maps: the least possible maximum of |μ|, and |μ| as even as a Teichmüller map's.

Both start from the default's map and never fold. The classic Teichmüller iteration (Lui, Lam, Yau,
Gu 2014) equalises |μ| by a fixed point that need not converge and may fold; here a penalty on
|μ|² - κ² does, with as much smoothness of μ as Newton's method needs to converge.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from engine.quasiconformal._newton import Descent
from engine.quasiconformal._plane import Constraints, PreparedPlane
from engine.quasiconformal._smooth import CoefficientSmoother, Objective

_POWERS = (2.0, 8.0, 32.0, 128.0, 256.0)
_BETWEEN = 0.05  # tolerance of a stage that is only passed through
_BETWEEN_MOST = 8
_SMOOTHNESS = 1.2  # of the default's hinge weights, against the penalty's 1
_BARRIER = 1e-4
_RAISES = (1.2, 1.2, 1.1)  # of κ over the root mean square of |μ| so far
_RAISING_MOST = 4


def least_maximum(
    plane: PreparedPlane, constraints: Constraints, start: Descent, tolerance: float, most: int
) -> Descent:
    """The least p-norm of (1 + |μ|²) / (1 - |μ|²) over triangles, p from 2 up to 256.

    Continues from ``start``, a fold-free map; ``most`` solves in all.
    """
    nothing = np.zeros(len(plane.faces))
    aim = Objective(np.zeros_like(plane.hinges.weight), nothing, nothing, nothing, gauss=True)
    smoother = CoefficientSmoother(plane, constraints)
    for power in _POWERS:
        last = power == _POWERS[-1]
        square = smoother.largest(start.w) ** 2
        scale = ((1.0 + square) / (1.0 - square)) ** -power / len(plane.faces)
        goal = replace(aim, face=np.full(len(plane.faces), scale), power=power)
        smoother = CoefficientSmoother(plane, constraints, goal)
        start = _continued(
            smoother,
            start,
            tolerance if last else _BETWEEN,
            most if last else min(most, start.solves + _BETWEEN_MOST),
        )
    return start


def even_coefficient(
    plane: PreparedPlane, constraints: Constraints, start: Descent, tolerance: float, most: int
) -> Descent:
    """The most even |μ|: least Σ A (|μ|² - κ²)² / (4 κ²) plus some variation of μ.

    κ is raised twice over the root mean square of |μ|, as the target of a map that has no freedom
    left. Continues from ``start``, a fold-free map; ``most`` solves in all.
    """
    count = len(plane.faces)
    share = plane.area / plane.area.sum()
    barrier, nothing = np.full(count, _BARRIER / count), np.zeros(count)
    hinge = _SMOOTHNESS * plane.hinges.weight
    smoother = CoefficientSmoother(plane, constraints)
    for stage, raised in enumerate(_RAISES, start=1):
        last = stage == len(_RAISES)
        square = float(share @ np.abs(smoother.coefficient(start.w)) ** 2)
        level = max(raised**2 * square, 1e-12)
        aim = Objective(hinge, barrier, nothing, share, power=1.0, level=level)
        smoother = CoefficientSmoother(plane, constraints, aim)
        start = _continued(
            smoother,
            start,
            tolerance,
            most if last else min(most, start.solves + _RAISING_MOST),
        )
    return start


def _continued(
    smoother: CoefficientSmoother, start: Descent, tolerance: float, most: int
) -> Descent:
    after = smoother.descend(start.w, tolerance=tolerance, most=most - start.solves)
    return Descent(
        after.w,
        (*start.residuals, *after.residuals),
        start.solves + after.solves,
        after.converged,
    )
