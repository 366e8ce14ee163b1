"""Morton's space-filling curve: what is near along it is near in space."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from engine.types import FloatArray, IntArray

_BITS = 21
_SPREAD = (
    (32, 0x1F00000000FFFF),
    (16, 0x1F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)


def order_along_curve(points: FloatArray, low: FloatArray, extent: float) -> IntArray:
    """Order of ``points`` (n, 3) along the curve through the cube from ``low`` (3,).

    ``extent`` is the cube's side, or 0 where all of it is one point. Points outside count as on
    the cube's surface. (G. M. Morton, "A computer oriented geodetic data base", 1966.)
    """
    scaled = (points - low) / (extent or 1.0)
    cells = (np.clip(scaled, 0, 1) * (2**_BITS - 1)).astype(np.uint64)
    code = np.zeros(len(points), dtype=np.uint64)
    for axis in range(3):
        code |= _spread_bits(cells[:, axis]) << np.uint64(axis)
    return np.argsort(code, kind="stable")


def _spread_bits(cells: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Bits of 21-bit numbers three places apart."""
    spread = cells
    for shift, mask in _SPREAD:
        spread = (spread | (spread << np.uint64(shift))) & np.uint64(mask)
    return spread
