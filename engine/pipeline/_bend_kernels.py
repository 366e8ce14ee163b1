"""A smooth plane field summed from bumps (Wendland 1995)."""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import ComplexArray, FloatArray


@kernel
def bump(distance: float) -> float:
    """1 at 0, 0 from 1 on, twice differentiable; positive definite in the plane."""
    if distance >= 1.0:
        return 0.0
    low = (1.0 - distance) * (1.0 - distance)
    return low * low * (4.0 * distance + 1.0)


@kernel
def bumps(z: ComplexArray, centres: ComplexArray, reach: float) -> FloatArray:
    """The bump (n, k) of each of ``centres`` (k,) at each of ``z`` (n,)."""
    out = np.empty((len(z), len(centres)))
    for i in range(len(z)):
        for j in range(len(centres)):
            out[i, j] = bump(abs(z[i] - centres[j]) / reach)
    return out


@kernel
def bent(
    z: ComplexArray, centres: ComplexArray, strength: ComplexArray, reach: float
) -> ComplexArray:
    """The sum (n,) of the bumps of ``centres`` (k,), each times its ``strength``, at ``z`` (n,)."""
    out = np.zeros_like(z)
    square = reach * reach
    for i in range(len(z)):
        for j in range(len(centres)):
            away = z[i] - centres[j]
            distance = away.real * away.real + away.imag * away.imag
            if distance < square:
                out[i] += bump(np.sqrt(distance) / reach) * strength[j]
    return out
